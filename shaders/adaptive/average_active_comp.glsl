// Replaces the sums of the texels of a list by their means, as average_frag.glsl has them for directions.
#include "lib/active_lib.glsl"

void main()
{
  ivec2 texel = active_texel(first_row, imageSize(sums).x);
  if (any(greaterThanEqual(texel, imageSize(sums)))) {
    return;
  }
  vec4 sum = imageLoad(sums, texel);
  float length_squared = dot(sum.xyz, sum.xyz);
  bool is_hit = sum.a >= 1.0 && length_squared > 0.0;
  imageStore(sums, texel,
             is_hit ? vec4(sum.xyz / sqrt(length_squared), 1.0) : vec4(0.0, 0.0, 0.0, sum.a > 0.0 ? -1.0 : 0.0));
}
