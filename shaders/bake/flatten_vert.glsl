// The high mesh, laid flat: its texture coordinates are its positions, and its normal is what gets interpolated.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  // Interpolation is linear, so that turning each corner turns every texel between them.
  v_normal = mat3(normal_matrix) * normal;
}
