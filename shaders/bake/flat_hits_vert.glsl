// Draws triangles in UV space. Three vertices in a row are one triangle.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_triangle = gl_VertexID / 3;
  int corner = gl_VertexID - v_triangle * 3;
  v_weights = vec2(corner == 1 ? 1.0 : 0.0, corner == 2 ? 1.0 : 0.0);
}
