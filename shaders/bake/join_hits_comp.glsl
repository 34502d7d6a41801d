// Puts the hits of Flatten beside those of rays: where no ray was cast, or where it missed.
#include "lib/active_lib.glsl"

void main()
{
  ivec2 texel = active_texel(first_row, texel_size(positions).x);
  if (any(greaterThanEqual(texel, texel_size(positions)))) {
    return;
  }
  if (texel_at(positions, texel).a > 0.0 && (texel_at(left, texel).a == 0.0 || imageLoad(hits, texel).x == 0u)) {
    imageStore(hits, texel, texel_at(flat_hits, texel));
  }
}
