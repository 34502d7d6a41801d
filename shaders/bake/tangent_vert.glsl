// Draws the low mesh in UV space, with its normals and tangents.
#include "lib/uvspace_lib.glsl"
#include "lib/basis_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_normal = normal;
  v_tangent = tangent;
  v_bitangent = basis_bitangent(normal, tangent);
}
