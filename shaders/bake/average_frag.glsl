// Writes the mean of the samples that hit; directions are normalized again. Alpha is as for a single sample: a texel is
// missed only if none of its rays hit.
#include "lib/accumulate_lib.glsl"

void main()
{
  vec4 sum = texel_at(sums, ivec2(gl_FragCoord.xy));
  float length_squared = dot(sum.xyz, sum.xyz);
  bool is_hit = sum.a >= 1.0 && (length_squared > 0.0 || is_direction == 0);
  float divisor = is_direction != 0 ? sqrt(length_squared) : floor(sum.a);
  normal_out = is_hit ? vec4(sum.xyz / divisor, 1.0) : vec4(0.0, 0.0, 0.0, sum.a > 0.0 ? -1.0 : 0.0);
}
