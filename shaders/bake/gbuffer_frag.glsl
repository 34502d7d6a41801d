// Writes the ray of each texel: a point on the low mesh, and the unit direction away from its surface.
#include "lib/direction_lib.glsl"

void main()
{
  float length_squared = dot(v_direction, v_direction);
  if (!direction_exists(length_squared)) {
    discard;
  }
  position_out = vec4(v_position, 1.0);
  direction_out = vec4(v_direction / sqrt(length_squared), 1.0);
}
