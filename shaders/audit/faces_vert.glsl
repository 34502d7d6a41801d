// The low mesh, laid flat, with its triangles' numbers.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_number = number;
}
