// Draws triangles in UV space. Three vertices in a row are one triangle.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  int triangle = gl_VertexID / 3;
  int corner = gl_VertexID - triangle * 3;
  // In two parts, which floats hold exactly where rasterizers interpolate them.
  v_number = vec2(float(triangle >> 12), float(triangle & 4095));
  v_weights = vec2(corner == 1 ? 1.0 : 0.0, corner == 2 ? 1.0 : 0.0);
}
