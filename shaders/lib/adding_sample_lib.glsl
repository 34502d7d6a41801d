// Adds one sample of each texel to the sums.
#include "lib/accumulate_lib.glsl"

void adding_sample()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, texel_size(normals)))) {
    return;
  }
  vec4 normal = texel_at(normals, texel);
  if (normal.a == 0.0 && is_first == 0) {
    return;
  }
  vec4 sum = is_first != 0 ? vec4(0.0) : sums_load(texel);
  if (normal.a > 0.0) {
    sum += vec4(normal.xyz, 1.0);
  }
  else if (normal.a < 0.0) {
    sum.a += ACCUMULATE_MISS;
  }
  sums_store(texel, sum);
}
