// Draws the high mesh in UV space: its texture coordinates are the positions, and its normal is interpolated.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  // Interpolation is linear: transforming the corners transforms all texels between them.
  v_normal = mat3(normal_matrix) * normal;
}
