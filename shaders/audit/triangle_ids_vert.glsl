// Draws the low mesh in UV space, with the numbers of its triangles.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_number = number;
}
