// Encodes the first channel as a block of BC4, or the first two, each by itself, as a block of BC5: least squares. A lane for
// each block.
#include "lib/bc4_read_lib.glsl"

void main()
{
  ivec2 block = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(block, imageSize(blocks)))) {
    return;
  }
  Bc4Rows counts = bc4_read_weights(block * 4);
  uvec4 packed_block = uvec4(0u);
  for (int channel = 0; channel < channels; channel++) {
    Bc4Rows values = bc4_read_channel(block * 4, channel);
    ivec3 ends = bc4_search(values, counts);
    uvec2 half_block = bc4_packed(ends, bc4_indices(values, ends));
    packed_block = channel == 0 ? uvec4(half_block, 0u, 0u) : uvec4(packed_block.xy, half_block);
  }
  imageStore(blocks, block, packed_block);
}
