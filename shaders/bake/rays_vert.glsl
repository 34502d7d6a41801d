// Draws the low mesh in UV space, with what rays need.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_position = position;
  v_smooth_normal = smooth_normal;
  v_straight_normal = straight_normal;
  v_number = number;
  v_paint = paint;
}
