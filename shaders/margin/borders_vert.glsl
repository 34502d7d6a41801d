// Strips along the borders of UV islands: uv, depth and the border's number.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(corner.xy, uv_to_clip);
  gl_Position.z = corner.z;
  v_number = corner.w;
}
