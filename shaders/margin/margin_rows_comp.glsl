// Finds the offset, in columns, to the nearest written texel of the same row: 0 for a written texel, MARGIN_NONE if none is
// within `farthest`. One invocation per row, which reads and writes each texel once.
#include "lib/margin_lib.glsl"

void main()
{
  int y = int(gl_GlobalInvocationID.x);
  ivec2 size = texel_size(values);
  if (y >= size.y) {
    return;
  }
  // A texel between two written ones takes the nearer; before the first and after the last there is only one.
  int left = -MARGIN_NONE;
  int x = 0;
  for (int next = 0; next <= size.x; next++) {
    bool is_end = next == size.x;
    if (!is_end && texel_at(values, ivec2(next, y)).a <= 0.0) {
      continue;
    }
    int right = is_end ? 2 * MARGIN_NONE : next;
    for (; x < min(next + 1, size.x); x++) {
      int offset = x - left < right - x ? left - x : right - x;
      imageStore(offsets, ivec2(x, y), ivec4(abs(offset) <= farthest ? offset : MARGIN_NONE, 0, 0, 0));
    }
    left = next;
  }
}
