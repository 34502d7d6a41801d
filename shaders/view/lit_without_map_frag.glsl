// Lights a mesh by its interpolated normal. The light is the last column of `shading`.
#include "lib/lit_lib.glsl"

void main()
{
  color_out = lit_color(v_normal / max(length(v_normal), 1e-20), v_position, shading[3]);
}
