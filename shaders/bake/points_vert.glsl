// The high mesh, laid flat, with where its surface lies in space.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_position = position;
  v_labels = labels;
}
