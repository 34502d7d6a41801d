// Notes which texels are written, as bits: one invocation for 32 texels of a row, the first in the lowest bit.
#include "lib/margin_lib.glsl"

void main()
{
  ivec2 word = ivec2(gl_GlobalInvocationID.xy);
  ivec2 size = texel_size(values);
  int start = word.x * MARGIN_WORD;
  if (start >= size.x || word.y >= size.y) {
    return;
  }
  uint bits = 0u;
  int count = min(MARGIN_WORD, size.x - start);
  for (int i = 0; i < count; i++) {
    if (texel_at(values, ivec2(start + i, word.y)).a > 0.0) {
      bits |= 1u << uint(i);
    }
  }
  imageStore(written, word, ivec4(int(bits), 0, 0, 0));
}
