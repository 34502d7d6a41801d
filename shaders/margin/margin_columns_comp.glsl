// Finds the row of the nearest written texel, of several as near the lowest. MARGIN_NONE if the rows up to `farthest` away have
// none; -1 - row if it is the nearest and out of reach.
//
// From a texel to the one above it, the row of the nearest never decreases: where the nearest of two texels stand in one column,
// the higher one gains with each row. So the nearest of a texel lies between those of texels below and above it. The first pass
// searches every `step`-th row. Each later one takes the gaps between those that were searched, of four times `step`, and searches
// the row in the middle of a gap, then those beside it. One invocation per texel of the first pass, and per gap.
#include "lib/margin_lib.glsl"

// Which rows of a gap a dispatch searches: those of high maps take several, since drivers end long loops.
const int COLUMNS_ALL = 0;
const int COLUMNS_MIDDLE = 1;
const int COLUMNS_BELOW = 2;
const int COLUMNS_ABOVE = 3;

int columns_offset(int x, int y)
{
  return texel_at(offsets, ivec2(x, y)).x;
}

// The lowest row of the nearest of texels above row y, for which `found` was found, and the highest one of texels below it.
int columns_lowest(int y, int found)
{
  return found == MARGIN_NONE ? y + farthest + 1 : max(found, -1 - found);
}

int columns_highest(int y, int found)
{
  return found == MARGIN_NONE ? y - farthest - 1 : max(found, -1 - found);
}

// Stores what is found for a texel whose nearest is in the rows from `lowest` to `highest`, and returns it.
int columns_search(int x, int y, int lowest, int highest)
{
  int height = texel_size(offsets).y;
  if (y >= height) {
    return height - 1;
  }
  int own = abs(columns_offset(x, y));
  if (own == 0) {
    imageStore(source_rows, ivec2(x, y), ivec4(y, 0, 0, 0));
    return y;
  }
  // Only rows nearer than the texel in the same row can have a nearer one.
  int most = min(farthest, own);
  lowest = max(lowest, max(0, y - most));
  highest = min(highest, min(height - 1, y + most));
  int least = MARGIN_NONE * MARGIN_NONE;  // more than any distance in a map
  ivec2 nearest = ivec2(MARGIN_NONE);
  for (int row = lowest; row <= highest; row++) {
    ivec2 way = ivec2(columns_offset(x, row), row - y);
    int square = way.x * way.x + way.y * way.y;
    if (square < least) {
      least = square;
      nearest = way;
    }
  }
  int found = nearest.y == MARGIN_NONE ? MARGIN_NONE : y + nearest.y;
  // A texel is filled if a row at most `reach` above or below it has a written texel at most `reach` columns away, which need not
  // be the nearest.
  if (found != MARGIN_NONE && max(abs(nearest.x), abs(nearest.y)) > reach) {
    bool is_near = false;
    if (least <= 2 * reach * reach) {
      for (int row = max(0, y - reach); row <= min(height - 1, y + reach) && !is_near; row++) {
        is_near = abs(columns_offset(x, row)) <= reach;
      }
    }
    found = is_near ? found : -1 - found;
  }
  imageStore(source_rows, ivec2(x, y), ivec4(found, 0, 0, 0));
  return found;
}

void main()
{
  ivec2 size = texel_size(offsets);
  int x = int(gl_GlobalInvocationID.x);
  int y = int(gl_GlobalInvocationID.y) * (is_first != 0 ? step : 4 * step);
  if (x >= size.x || y >= size.y) {
    return;
  }
  if (is_first != 0) {
    columns_search(x, y, 0, size.y - 1);
    return;
  }
  int end = y + 4 * step;
  int lowest = columns_lowest(y, imageLoad(source_rows, ivec2(x, y)).x);
  int highest = columns_highest(end, end < size.y ? imageLoad(source_rows, ivec2(x, end)).x : size.y - 1);
  int half_way = y + 2 * step;
  int middle = size.y - 1;
  if (part <= COLUMNS_MIDDLE) {
    middle = columns_search(x, half_way, lowest, highest);
  }
  else if (half_way < size.y) {
    middle = imageLoad(source_rows, ivec2(x, half_way)).x;
  }
  if (part == COLUMNS_ALL || part == COLUMNS_BELOW) {
    columns_search(x, y + step, lowest, columns_highest(half_way, middle));
  }
  if (part == COLUMNS_ALL || part == COLUMNS_ABOVE) {
    columns_search(x, y + 3 * step, columns_lowest(half_way, middle), highest);
  }
}
