// Writes the mean of the samples that hit.
#include "lib/mean_lib.glsl"

void main()
{
  vec4 sum = texel_at(sums, ivec2(gl_FragCoord.xy));
  normal_out = is_direction != 0 ? mean_direction(sum) : mean_value(sum);
}
