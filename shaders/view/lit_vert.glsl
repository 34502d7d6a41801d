// Draws the low mesh in the viewport, with its UVs and tangents to read the map (Gumbau, González and Chover, Algorithm 3).
#include "lib/basis_lib.glsl"

void main()
{
  gl_Position = view_projection * vec4(position, 1.0);
  v_position = position;
  v_normal = normal;
  v_uv = uv;
  v_tangent = tangent;
  v_bitangent = basis_bitangent(normal, tangent);
}
