// Draws the high mesh in UV space, with its positions.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_position = position;
  v_labels = labels;
}
