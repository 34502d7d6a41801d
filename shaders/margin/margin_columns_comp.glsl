// Finds the row of the nearest written texel, MARGIN_NONE if none is in reach: the lower envelope of parabolas, one for the
// nearest texel of each row (Meijster, Roerdink and Hesselink, "A general algorithm for computing distance transforms in
// linear time", 2000). One invocation per column. The stack of parabolas uses the texels of the result.
#include "lib/margin_lib.glsl"

const int COLUMNS_BITS = 15;

// A parabola: its row, and the first row where it is the lowest.
ivec2 columns_load(ivec2 place)
{
  imageFence(source_rows);
  int entry = imageLoad(source_rows, place).x;
  return ivec2(entry & ((1 << COLUMNS_BITS) - 1), entry >> COLUMNS_BITS);
}

void columns_store(ivec2 place, ivec2 parabola)
{
  imageStore(source_rows, place, ivec4(parabola.x | (parabola.y << COLUMNS_BITS), 0, 0, 0));
}

// The square of the distance within the row.
int columns_square(ivec2 place)
{
  int offset = texel_at(offsets, place).x;
  return offset * offset;
}

void main()
{
  int x = int(gl_GlobalInvocationID.x);
  ivec2 size = texel_size(offsets);
  if (x >= size.x) {
    return;
  }
  int depth = -1;  // of the top parabola, which is kept in `upper` and not on the stack
  ivec2 upper = ivec2(0);
  int upper_square = 0;
  ivec2 open = ivec2(size.y, -1);  // the first and the last row whose texel is not written
  for (int y = 0; y < size.y; y++) {
    int square = columns_square(ivec2(x, y));
    if (square != 0) {
      open = ivec2(min(open.x, y), y);
    }
    if (square == MARGIN_NONE * MARGIN_NONE) {
      continue;
    }
    // Written texels are their own nearest: of a run of them, the first and the last are enough.
    if (square == 0 && depth >= 0 && all(equal(upper, ivec2(y - 1))) && upper_square == 0) {
      upper = ivec2(y);
      continue;
    }
    // Remove the parabolas that are not the lowest even where they begin.
    while (depth >= 0) {
      ivec2 down = upper.y - ivec2(upper.x, y);
      if (down.x * down.x + upper_square <= down.y * down.y + square) {
        break;
      }
      depth--;
      if (depth >= 0) {
        upper = columns_load(ivec2(x, depth));
        upper_square = columns_square(ivec2(x, upper.x));
      }
    }
    int first = 0;
    if (depth >= 0) {
      first = (y * y - upper.x * upper.x + square - upper_square) / (2 * (y - upper.x)) + 1;
      if (first >= size.y) {
        continue;
      }
      columns_store(ivec2(x, depth), upper);
    }
    depth++;
    upper = ivec2(y, first);
    upper_square = square;
  }
  // Go backwards: each parabola on the stack is the lowest somewhere, so its entry is below the row being written, and is
  // read before it is overwritten. A texel is filled if a row at most `reach` above or below it has a written texel at most
  // `reach` columns away.
  int in_reach = open.y < size.y - 1 ? open.y + 1 : 2 * MARGIN_NONE;
  for (int y = open.y + reach; y >= open.x; y--) {
    ivec2 entering = ivec2(x, y - reach);
    if (entering.y >= 0 && columns_square(entering) <= reach * reach) {
      in_reach = entering.y;
    }
    if (y > open.y) {
      continue;
    }
    while (depth > 0 && y < upper.y) {
      depth--;
      upper = columns_load(ivec2(x, depth));
    }
    int row = in_reach <= y + reach ? upper.x : MARGIN_NONE;
    imageStore(source_rows, ivec2(x, y), ivec4(row, 0, 0, 0));
  }
}
