// The low mesh, laid flat, to be counted.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
}
