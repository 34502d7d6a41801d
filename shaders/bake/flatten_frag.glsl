// Writes the interpolated normal of the high mesh, normalized (Gumbau, González and Chover, Algorithm 2). Alpha is 1 where a
// texel was written.
#include "lib/direction_lib.glsl"

void main()
{
  float length_squared = dot(v_normal, v_normal);
  // Opposite corner normals cancel out between them: a texel without a direction is not written.
  if (!direction_exists(length_squared)) {
    discard;
  }
  // Not normalize(): its reciprocal square root of 1 need not be exactly 1.
  normal_out = vec4(v_normal / sqrt(length_squared), 1.0);
}
