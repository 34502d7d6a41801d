// What the colours of the deviation stand for.
#include "lib/ramp_lib.glsl"

void main()
{
  colour_out = vec4(ramp_colour(v_share), 1.0);
}
