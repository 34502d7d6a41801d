// Replaces the sums of the texels of a list by their means.
#include "lib/active_lib.glsl"
#include "lib/mean_lib.glsl"

void main()
{
  ivec2 texel = active_texel(first_row, imageSize(sums).x);
  if (any(greaterThanEqual(texel, imageSize(sums)))) {
    return;
  }
  imageStore(sums, texel, mean_direction(imageLoad(sums, texel)));
}
