// Encodes three channels of floats as a block of BC6H, without signs or with them. A lane for each block.
//
// All is counted in the steps between neighboring halfs, in whole numbers. The errors of `is_linear` are those of values, others
// those of steps, which are in proportion to the value. The finest mode in which the texels fit is searched in one region, and the
// finest one in two, for the partition whose regions are nearest to lines; the better one stays.
#include "lib/bc4_read_lib.glsl"

const int LARGEST = 31743;  // steps up to 65504
const int NARROW = 1023;
const int FARTHEST = 4095;
const int ROUNDS = 5;
const uint NEVER = 4294967295u;
const int MODES_OF_ONE = 4;  // rows of `modes`: those of one region, those of two, and the partitions
const int MODES_OF_ALL = 14;
const int PARTITIONS = 32;
const int FIRST_BIT = 2;  // the column after those that hold a mode's numbers
const int SLOT_OF_PARTITION = 12;

struct Texels {
  Bc4Rows r;
  Bc4Rows g;
  Bc4Rows b;
};

struct Mode {
  int code;
  int code_bits;
  int depth;
  int is_relative;
  ivec3 others;  // bits of the ends but the first
};

// What the ends may be at least and at most, so that each differs from each other by no more than a mode stores.
struct Box {
  ivec3 least;
  ivec3 most;
  bool fits;
};

struct Ends {
  ivec3 first;
  ivec3 second;
  uint cost;
};

// How errors are measured: the highest exponent of the block, and how many bits of errors do not count.
struct Measure {
  int highest;
  int shift;
};

// The steps of the nearest half, of two the even one. No number is 0.
int half_steps(float value)
{
  int bits = floatBitsToInt(value);
  int size = bits & 2147483647;
  bool is_below = bits < 0;
  int steps = 0;
  if (size > 2139095040) {
    return 0;
  }
  if (size >= 947912704) {  // 2^-14
    steps = (min(size, 1199562752) - 939524096 + 4095 + ((size >> 13) & 1)) >> 13;
  }
  else {
    int down = 126 - (size >> 23);
    if (down < 26) {
      int mantissa = (size & 8388607) | 8388608;
      steps = (mantissa + (1 << (down - 1)) - 1 + ((mantissa >> down) & 1)) >> down;
    }
  }
  steps = min(steps, LARGEST);
  return is_below ? (is_signed != 0 ? -steps : 0) : steps;
}

// The value of a half as a whole number: at the highest exponent from 1024 to 2047, twice without signs.
int linear_steps(int steps, int highest)
{
  int size = abs(steps);
  int down = highest - max(size >> 10, 1);
  int mantissa = (size & 1023) + (size >= 1024 ? 1024 : 0);
  mantissa = is_signed != 0 ? mantissa : mantissa * 2;
  mantissa = down < 0 ? mantissa << min(-down, 4) : mantissa >> min(down, 15);
  return steps < 0 ? -mantissa : mantissa;
}

int measured(int steps, Measure measure)
{
  return is_linear != 0 ? linear_steps(steps, measure.highest) : steps;
}

Bc4Rows measured_rows(Bc4Rows steps, Measure measure)
{
  Bc4Rows rows;
  for (int i = 0; i < 4; i++) {
    rows.a[i] = measured(steps.a[i], measure);
    rows.b[i] = measured(steps.b[i], measure);
    rows.c[i] = measured(steps.c[i], measure);
    rows.d[i] = measured(steps.d[i], measure);
  }
  return rows;
}

Bc4Rows steps_of_channel(ivec2 start, int channel)
{
  Bc4Rows rows;
  for (int x = 0; x < 4; x++) {
    rows.a[x] = half_steps(texel_at(texels, start + ivec2(x, 0))[channel]);
    rows.b[x] = half_steps(texel_at(texels, start + ivec2(x, 1))[channel]);
    rows.c[x] = half_steps(texel_at(texels, start + ivec2(x, 2))[channel]);
    rows.d[x] = half_steps(texel_at(texels, start + ivec2(x, 3))[channel]);
  }
  return rows;
}

// The number in bits that an end is stored with.
int quantized(int steps, int depth)
{
  int size = abs(steps);
  int wide = is_signed != 0 ? (size * 32 + 30) / 31 : (size * 64 + 30) / 31;
  wide = wide >> (16 - depth);
  return steps < 0 ? -wide : wide;
}

ivec3 quantized_ends(ivec3 steps, int depth)
{
  return ivec3(quantized(steps.x, depth), quantized(steps.y, depth), quantized(steps.z, depth));
}

int largest_end(int depth)
{
  return (1 << (is_signed != 0 ? depth - 1 : depth)) - 1;
}

int unquantized(int end, int depth)
{
  int size = abs(end);
  int most = is_signed != 0 ? 32767 : 65535;
  int wide = size == largest_end(depth) ? most : (2 * size + 1) << (15 - depth);
  wide = size == 0 ? 0 : wide;
  return end < 0 ? -wide : wide;
}

ivec3 unquantized_ends(ivec3 ends, int depth)
{
  if (depth == 16) {
    return ends;
  }
  return ivec3(unquantized(ends.x, depth), unquantized(ends.y, depth), unquantized(ends.z, depth));
}

int finished(int wide)
{
  int size = (abs(wide) * 31) >> (is_signed != 0 ? 5 : 6);
  return wide < 0 ? -size : size;
}

// The color of an index, as errors are measured, between ends that are wide, or steps.
ivec3 color_of(ivec3 first, ivec3 second, int index, int last, bool is_wide, Measure measure)
{
  int weight = (128 * index + last) / (2 * last);
  ivec3 color = ((64 - weight) * first + weight * second + 32) >> 6;
  if (is_wide) {
    color = ivec3(finished(color.x), finished(color.y), finished(color.z));
  }
  return ivec3(measured(color.x, measure), measured(color.y, measure), measured(color.z, measure));
}

uvec4 squares(ivec4 values, int color, int shift)
{
  uvec4 off = uvec4(min(abs(values - color) >> shift, ivec4(FARTHEST)));
  return off * off;
}

uvec4 row_errors(ivec4 r, ivec4 g, ivec4 b, ivec3 color, int shift)
{
  return squares(r, color.x, shift) + squares(g, color.y, shift) + squares(b, color.z, shift);
}

uint row_sum(uvec4 errors, ivec4 counts)
{
  uvec4 costs = errors * uvec4(counts);
  return costs.x + costs.y + costs.z + costs.w;
}

uint cost_of(Texels aim, Bc4Rows counts, ivec3 first, ivec3 second, int last, bool is_wide, Measure measure)
{
  uvec4 a = uvec4(NEVER);
  uvec4 b = uvec4(NEVER);
  uvec4 c = uvec4(NEVER);
  uvec4 d = uvec4(NEVER);
  for (int index = 0; index <= last; index++) {
    ivec3 color = color_of(first, second, index, last, is_wide, measure);
    a = min(a, row_errors(aim.r.a, aim.g.a, aim.b.a, color, measure.shift));
    b = min(b, row_errors(aim.r.b, aim.g.b, aim.b.b, color, measure.shift));
    c = min(c, row_errors(aim.r.c, aim.g.c, aim.b.c, color, measure.shift));
    d = min(d, row_errors(aim.r.d, aim.g.d, aim.b.d, color, measure.shift));
  }
  return row_sum(a, counts.a) + row_sum(b, counts.b) + row_sum(c, counts.c) + row_sum(d, counts.d);
}

Bc4Rows nearest(Texels aim, ivec3 first, ivec3 second, int last, Measure measure)
{
  Bc4Rows found;
  found.a = ivec4(0);
  found.b = ivec4(0);
  found.c = ivec4(0);
  found.d = ivec4(0);
  uvec4 least_a = uvec4(NEVER);
  uvec4 least_b = uvec4(NEVER);
  uvec4 least_c = uvec4(NEVER);
  uvec4 least_d = uvec4(NEVER);
  for (int index = 0; index <= last; index++) {
    ivec3 color = color_of(first, second, index, last, true, measure);
    uvec4 a = row_errors(aim.r.a, aim.g.a, aim.b.a, color, measure.shift);
    uvec4 b = row_errors(aim.r.b, aim.g.b, aim.b.b, color, measure.shift);
    uvec4 c = row_errors(aim.r.c, aim.g.c, aim.b.c, color, measure.shift);
    uvec4 d = row_errors(aim.r.d, aim.g.d, aim.b.d, color, measure.shift);
    found.a += ivec4(lessThan(a, least_a)) * (index - found.a);
    found.b += ivec4(lessThan(b, least_b)) * (index - found.b);
    found.c += ivec4(lessThan(c, least_c)) * (index - found.c);
    found.d += ivec4(lessThan(d, least_d)) * (index - found.d);
    least_a = min(least_a, a);
    least_b = min(least_b, b);
    least_c = min(least_c, c);
    least_d = min(least_d, d);
  }
  return found;
}

// The least and the largest steps of a channel of the texels that count.
ivec2 range_of(Bc4Rows steps, Bc4Rows counts)
{
  ivec4 low = ivec4(LARGEST);
  ivec4 high = ivec4(-LARGEST);
  for (int i = 0; i < 4; i++) {
    ivec4 values = ivec4(steps.a[i], steps.b[i], steps.c[i], steps.d[i]);
    ivec4 is_counted = ivec4(greaterThan(ivec4(counts.a[i], counts.b[i], counts.c[i], counts.d[i]), ivec4(0)));
    low = min(low, is_counted * values + (1 - is_counted) * LARGEST);
    high = max(high, is_counted * values - (1 - is_counted) * LARGEST);
  }
  return ivec2(min(min(low.x, low.y), min(low.z, low.w)), max(max(high.x, high.y), max(high.z, high.w)));
}

// The texels of a region, by the bits of those of the second one.
ivec4 in_region(int second, int region)
{
  ivec4 bits = (ivec4(second) >> ivec4(0, 1, 2, 3)) & 1;
  return region == 1 ? bits : 1 - bits;
}

Bc4Rows counts_in(Bc4Rows counts, int second, int region)
{
  Bc4Rows rows;
  rows.a = counts.a * in_region(second, region);
  rows.b = counts.b * in_region(second >> 4, region);
  rows.c = counts.c * in_region(second >> 8, region);
  rows.d = counts.d * in_region(second >> 12, region);
  return rows;
}

// How two channels go together: above 0 if both rise.
int row_together(ivec4 one, ivec4 other, ivec4 counts, ivec2 middles, int narrow)
{
  ivec4 products = ((one - middles.x) >> narrow) * ((other - middles.y) >> narrow) * counts;
  return products.x + products.y + products.z + products.w;
}

int together(Bc4Rows one, Bc4Rows other, Bc4Rows counts, ivec2 middles, int narrow)
{
  return row_together(one.a, other.a, counts.a, middles, narrow) + row_together(one.b, other.b, counts.b, middles, narrow) +
         row_together(one.c, other.c, counts.c, middles, narrow) + row_together(one.d, other.d, counts.d, middles, narrow);
}

// The error of the texels of a region to the diagonal of their extremes.
uint diagonal_cost(Texels steps, Texels aim, Bc4Rows counts, int narrow, Measure measure)
{
  ivec2 r = range_of(steps.r, counts);
  ivec2 g = range_of(steps.g, counts);
  ivec2 b = range_of(steps.b, counts);
  if (r.x > r.y) {
    return 0u;
  }
  ivec3 low = ivec3(r.x, g.x, b.x);
  ivec3 high = ivec3(r.y, g.y, b.y);
  ivec3 width = high - low;
  ivec3 middle = (low + high) >> 1;
  Bc4Rows widest = steps.r;
  int its_middle = middle.x;
  if (width.y > width.x && width.y >= width.z) {
    widest = steps.g;
    its_middle = middle.y;
  }
  else if (width.z > width.x && width.z > width.y) {
    widest = steps.b;
    its_middle = middle.z;
  }
  ivec3 rise = ivec3(
    together(steps.r, widest, counts, ivec2(middle.x, its_middle), narrow),
    together(steps.g, widest, counts, ivec2(middle.y, its_middle), narrow),
    together(steps.b, widest, counts, ivec2(middle.z, its_middle), narrow)
  );
  ivec3 is_turned = ivec3(lessThan(rise, ivec3(0)));
  return cost_of(aim, counts, low + is_turned * width, high - is_turned * width, 7, false, measure);
}

Mode mode_of(int row)
{
  ivec4 numbers = ivec4(texel_at(modes, ivec2(0, row)));
  ivec4 more = ivec4(texel_at(modes, ivec2(1, row)));
  Mode mode;
  mode.code = numbers.x;
  mode.code_bits = numbers.y;
  mode.depth = numbers.z;
  mode.is_relative = numbers.w;
  mode.others = more.xyz;
  return mode;
}

Box box_of(Mode mode, ivec3 low, ivec3 high)
{
  ivec3 first = quantized_ends(low, mode.depth);
  ivec3 last = quantized_ends(high, mode.depth);
  int most = largest_end(mode.depth);
  ivec3 room = ivec3(2 * most);
  if (mode.is_relative != 0) {
    room = (ivec3(1) << (mode.others - 1)) - 1 - (last - first);
  }
  Box box;
  box.fits = all(greaterThanEqual(room, ivec3(0)));
  box.least = max(first - (room >> 1), ivec3(is_signed != 0 ? -most : 0));
  box.most = min(last + room - (room >> 1), ivec3(most));
  return box;
}

// The first of some modes that the texels fit in.
int finest_mode(int row, ivec3 low, ivec3 high)
{
  while (!box_of(mode_of(row), low, high).fits) {
    row++;
  }
  return row;
}

// The ends of least cost: first the diagonals of the extremes, then one number after another, with smaller and smaller steps.
Ends searched(Texels aim, Bc4Rows counts, ivec3 low, ivec3 high, Box box, int depth, int last, Measure measure)
{
  Ends found;
  found.first = low;
  found.second = high;
  found.cost = NEVER;
  for (int turn = 0; turn < 4 + 12 * ROUNDS; turn++) {
    ivec3 first = found.first;
    ivec3 second = found.second;
    if (turn < 4) {
      ivec3 is_turned = ivec3(0, turn & 1, turn >> 1);
      first = low + is_turned * (high - low);
      second = high - is_turned * (high - low);
    }
    else {
      int move = (turn - 4) % 12;
      ivec3 is_moved = ivec3(equal(ivec3(move % 3), ivec3(0, 1, 2)));
      ivec3 by = max(ivec3(1), (high - low) >> (3 + (turn - 4) / 12)) * is_moved * (move < 6 ? 1 : -1);
      int is_second = (move / 3) & 1;
      first += (1 - is_second) * by;
      second += is_second * by;
    }
    if (all(greaterThanEqual(min(first, second), box.least)) && all(lessThanEqual(max(first, second), box.most))) {
      uint cost = cost_of(
        aim, counts, unquantized_ends(first, depth), unquantized_ends(second, depth), last, true, measure
      );
      if (cost < found.cost) {
        found.first = first;
        found.second = second;
        found.cost = cost;
      }
    }
  }
  return found;
}

int index_at(Bc4Rows rows, int texel)
{
  ivec4 row = texel < 8 ? (texel < 4 ? rows.a : rows.b) : (texel < 12 ? rows.c : rows.d);
  return row[texel & 3];
}

// A block with a number of bits from `at` on.
uvec4 with_bits(uvec4 block, int at, int number)
{
  int word = at >> 5;
  int up = at & 31;
  block[word] |= uint(number) << uint(up);
  if (up > 0 && word < 3) {
    block[word + 1] |= uint(number) >> uint(32 - up);
  }
  return block;
}

void main()
{
  ivec2 block = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(block, imageSize(blocks)))) {
    return;
  }
  ivec2 start = block * 4;
  Bc4Rows counts = bc4_read_weights(start);
  counts.a = (counts.a + 3) >> 2;
  counts.b = (counts.b + 3) >> 2;
  counts.c = (counts.c + 3) >> 2;
  counts.d = (counts.d + 3) >> 2;
  Texels steps;
  steps.r = steps_of_channel(start, 0);
  steps.g = steps_of_channel(start, 1);
  steps.b = steps_of_channel(start, 2);

  ivec2 r = range_of(steps.r, counts);
  ivec2 g = range_of(steps.g, counts);
  ivec2 b = range_of(steps.b, counts);
  ivec3 low = ivec3(r.x, g.x, b.x);
  ivec3 high = ivec3(r.y, g.y, b.y);
  ivec3 size = max(abs(low), abs(high));
  ivec3 width = high - low;
  int narrow = 0;
  while (max(max(width.x, width.y), width.z) >> narrow > NARROW) {
    narrow++;
  }
  Measure measure;
  measure.highest = max(max(max(size.x, size.y), size.z) >> 10, 1);
  measure.shift = is_linear != 0 ? 0 : narrow;
  Texels aim;
  aim.r = measured_rows(steps.r, measure);
  aim.g = measured_rows(steps.g, measure);
  aim.b = measured_rows(steps.b, measure);

  int row = finest_mode(0, low, high);
  Mode mode = mode_of(row);
  Box box = box_of(mode, low, high);
  Ends whole = searched(
    aim, counts, quantized_ends(low, mode.depth), quantized_ends(high, mode.depth), box, mode.depth, 15, measure
  );

  int split_by = 0;
  uint least = NEVER;
  for (int each = 0; each < PARTITIONS; each++) {
    int second = int(texel_at(modes, ivec2(each, MODES_OF_ALL)).x);
    uint cost = 0u;
    for (int region = 0; region < 2; region++) {
      cost += diagonal_cost(steps, aim, counts_in(counts, second, region), narrow, measure);
    }
    if (cost < least) {
      least = cost;
      split_by = each;
    }
  }
  ivec2 partition_numbers = ivec2(texel_at(modes, ivec2(split_by, MODES_OF_ALL)).xy);
  int second_region = partition_numbers.x;
  int row_of_two = finest_mode(MODES_OF_ONE, low, high);
  Mode mode_of_two = mode_of(row_of_two);
  box = box_of(mode_of_two, low, high);
  Ends parts_first = whole;
  Ends parts_second = whole;
  for (int region = 0; region < 2; region++) {
    Bc4Rows own = counts_in(counts, second_region, region);
    r = range_of(steps.r, own);
    g = range_of(steps.g, own);
    b = range_of(steps.b, own);
    ivec3 own_low = r.x > r.y ? low : ivec3(r.x, g.x, b.x);
    ivec3 own_high = r.x > r.y ? high : ivec3(r.y, g.y, b.y);
    int depth = mode_of_two.depth;
    Ends part = searched(
      aim, own, quantized_ends(own_low, depth), quantized_ends(own_high, depth), box, depth, 7, measure
    );
    if (region == 0) {
      parts_first = part;
    }
    else {
      parts_second = part;
    }
  }

  bool is_split = parts_first.cost + parts_second.cost < whole.cost;
  int last = 15;
  int bits = 4;
  int anchor = 0;
  if (is_split) {
    last = 7;
    bits = 3;
    anchor = partition_numbers.y;
    mode = mode_of_two;
    row = row_of_two;
    whole = parts_first;
  }
  else {
    second_region = 0;
    split_by = 0;
  }
  Bc4Rows indices;
  for (int region = 0; region < 2; region++) {
    Ends part = region == 0 ? whole : parts_second;
    Bc4Rows own = nearest(
      aim, unquantized_ends(part.first, mode.depth), unquantized_ends(part.second, mode.depth), last, measure
    );
    // An anchor lacks its highest bit: where that is not 0, the ends change places.
    if (index_at(own, region == 0 ? 0 : anchor) > last / 2) {
      own.a = last - own.a;
      own.b = last - own.b;
      own.c = last - own.c;
      own.d = last - own.d;
      ivec3 exchanged = part.first;
      part.first = part.second;
      part.second = exchanged;
    }
    if (region == 0) {
      whole = part;
      indices = own;
    }
    else {
      parts_second = part;
      indices.a += in_region(second_region, 1) * (own.a - indices.a);
      indices.b += in_region(second_region >> 4, 1) * (own.b - indices.b);
      indices.c += in_region(second_region >> 8, 1) * (own.c - indices.c);
      indices.d += in_region(second_region >> 12, 1) * (own.d - indices.d);
    }
  }

  ivec3 base = mode.is_relative != 0 ? whole.first : ivec3(0);
  uvec4 packed_block = uvec4(uint(mode.code), 0u, 0u, 0u);
  int at = 128 - 16 * bits + (is_split ? 2 : 1);
  for (int bit = mode.code_bits; bit < at; bit++) {
    ivec2 field = ivec2(texel_at(modes, ivec2(FIRST_BIT + bit - mode.code_bits, row)).xy);
    int end = field.x / 3;
    ivec3 value = end < 2 ? (end == 0 ? whole.first : whole.second - base) :
                            (end == 2 ? parts_second.first - base : parts_second.second - base);
    int number = field.x == SLOT_OF_PARTITION ? split_by : value[field.x % 3];
    packed_block = with_bits(packed_block, bit, (number >> field.y) & 1);
  }
  for (int texel = 0; texel < 16; texel++) {
    packed_block = with_bits(packed_block, at, index_at(indices, texel));
    at += texel == 0 || (is_split && texel == anchor) ? bits - 1 : bits;
  }
  imageStore(blocks, block, packed_block);
}
