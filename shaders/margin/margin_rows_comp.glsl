// Finds the offset, in columns, to the nearest written texel of the same row: 0 for a written texel, MARGIN_NONE if none is
// within `farthest`. One invocation for 32 texels of a row.
#include "lib/margin_lib.glsl"

void main()
{
  ivec2 word = ivec2(gl_GlobalInvocationID.xy);
  ivec2 size = imageSize(offsets);
  int start = word.x * MARGIN_WORD;
  if (start >= size.x || word.y >= size.y) {
    return;
  }
  // The nearest ones before and after these texels.
  int left = -MARGIN_NONE;
  for (int i = word.x - 1; i >= 0 && start - i * MARGIN_WORD < farthest + MARGIN_WORD; i--) {
    uint bits = uint(texel_at(written, ivec2(i, word.y)).x);
    if (bits != 0u) {
      left = i * MARGIN_WORD + findMSB(bits);
      break;
    }
  }
  int after = 2 * MARGIN_NONE;
  int words = texel_size(written).x;
  for (int i = word.x + 1; i < words && (i - 1) * MARGIN_WORD - start < farthest; i++) {
    uint bits = uint(texel_at(written, ivec2(i, word.y)).x);
    if (bits != 0u) {
      after = i * MARGIN_WORD + findLSB(bits);
      break;
    }
  }
  // A texel between two written ones takes the nearer; before the first and after the last there is only one.
  uint ahead = uint(texel_at(written, word).x);
  int count = min(MARGIN_WORD, size.x - start);
  for (int x = start; x < start + count; x++) {
    int right = ahead != 0u ? x + findLSB(ahead) : after;
    left = right == x ? x : left;
    ahead >>= 1;
    int offset = x - left < right - x ? left - x : right - x;
    imageStore(offsets, ivec2(x, word.y), ivec4(abs(offset) <= farthest ? offset : MARGIN_NONE, 0, 0, 0));
  }
}
