// Lights the low mesh by the normal from its map.
#include "lib/lit_lib.glsl"
#include "lib/map_lib.glsl"

void main()
{
  color_out = lit_color(map_normal(map_between(v_uv), v_normal, v_tangent, v_bitangent), v_position, shading[3]);
}
