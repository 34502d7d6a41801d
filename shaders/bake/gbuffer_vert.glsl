// The low mesh, laid flat, with where its rays start and where they come from.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_position = position;
  v_direction = direction;
}
