// Reads the results of the two searches, in the textures `offsets` and `source_rows`.
#include "lib/margin_lib.glsl"

// The offset from a texel to the nearest written one, MARGIN_NONE in both components if none is in reach.
ivec2 nearest_way(ivec2 texel)
{
  int row = texel_at(source_rows, texel).x;
  if (row < 0 || row == MARGIN_NONE) {
    return ivec2(MARGIN_NONE);
  }
  return ivec2(texel_at(offsets, ivec2(texel.x, row)).x, row - texel.y);
}
