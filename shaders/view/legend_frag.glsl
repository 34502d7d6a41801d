// Draws the color scale of the deviation.
#include "lib/ramp_lib.glsl"

void main()
{
  color_out = vec4(ramp_color(v_share), 1.0);
}
