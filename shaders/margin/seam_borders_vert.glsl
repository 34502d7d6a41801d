// Draws strips along the borders of UV islands. A corner holds uv, depth and the number of the border.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(corner.xy, uv_to_clip);
  gl_Position.z = corner.z;
  v_number = corner.w;
}
