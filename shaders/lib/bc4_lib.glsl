// A channel of a block in the format BC4: two endpoints in steps of 1/255, and for each texel one of eight values. If the
// first endpoint is the larger, all eight lie between both in equal steps; if not, six do, and two are 0 and 1.
//
// All numbers are whole, so that each driver has the same bits. Values are in units in which each of the eight is whole, and
// half a step as well. Four texels are in a vector: the rows of a block.

const int BC4_ONE = 71400;   // 255 * 7 * 5 * 8
const int BC4_STEP = 280;    // of endpoints
const int BC4_FARTHEST = 511;  // so that 16 squares with weights up to 1023 fit in 32 bits
const int BC4_MUCH = 8;  // half of the weight of a texel that counts
const uint BC4_NONE = 4294967295u;

struct Bc4Rows {
  ivec4 a;
  ivec4 b;
  ivec4 c;
  ivec4 d;
};

// A value in these units; what is no number counts as 0. A product with a power of two is exact, so that nothing depends on
// how a driver rounds.
int bc4_fixed(float value)
{
  uint steps = value > 0.0 ? uint(min(value, 1.0) * 262144.0 + 0.5) : 0u;
  return int((steps * 8925u + 16384u) >> 15);
}

ivec4 bc4_fixed_row(vec4 row)
{
  return ivec4(bc4_fixed(row.x), bc4_fixed(row.y), bc4_fixed(row.z), bc4_fixed(row.w));
}

// The squared distances of four texels to the nearest of the eight values. Equal steps are folded upon each other: about
// the middle, and about the middle of what is left.
uint bc4_row_cost(ivec4 values, ivec4 weights, int low, int high, bool is_six, int shift)
{
  int width = high - low;
  ivec4 off = abs(values - 140 * (low + high));
  if (is_six) {
    off = abs(abs(abs(off - 84 * width) - 28 * width) - 28 * width);
    off = min(off, min(abs(values), abs(BC4_ONE - values)));
  }
  else {
    off = abs(abs(abs(off - 80 * width) - 40 * width) - 20 * width);
  }
  off = min(off >> shift, ivec4(BC4_FARTHEST));
  off *= off;
  uvec4 costs = uvec4(off) * uvec4(weights);
  return costs.x + costs.y + costs.z + costs.w;
}

// The cost of two endpoints, the smaller first, and of whether six values are between them. BC4_NONE: no block has them.
uint bc4_cost(Bc4Rows values, Bc4Rows weights, ivec3 ends, int shift)
{
  bool is_six = ends.z != 0;
  if (ends.x < 0 || ends.y > 255 || ends.x > ends.y || (ends.x == ends.y && !is_six)) {
    return BC4_NONE;
  }
  return bc4_row_cost(values.a, weights.a, ends.x, ends.y, is_six, shift) +
         bc4_row_cost(values.b, weights.b, ends.x, ends.y, is_six, shift) +
         bc4_row_cost(values.c, weights.c, ends.x, ends.y, is_six, shift) +
         bc4_row_cost(values.d, weights.d, ends.x, ends.y, is_six, shift);
}

// The least and the largest of the values with at least this weight; with is_six, of those that are not about 0 or 1.
ivec2 bc4_row_range(ivec4 values, ivec4 weights, int least_weight, bool is_six)
{
  ivec2 range = ivec2(BC4_ONE, 0);
  for (int i = 0; i < 4; i++) {
    int value = clamp(values[i], 0, BC4_ONE);
    bool is_end = is_six && (value < BC4_STEP / 2 || value > BC4_ONE - BC4_STEP / 2);
    if (weights[i] >= least_weight && !is_end) {
      range = ivec2(min(range.x, value), max(range.y, value));
    }
  }
  return range;
}

// The endpoints of least cost, the smaller first, and whether they have six values between them: first on a grid around the
// extremes, with steps that grow with the distance between both, then around the best one, with steps half as large down to 1.
ivec3 bc4_search(Bc4Rows values, Bc4Rows weights)
{
  ivec3 found = ivec3(0, 0, 1);
  uint least = BC4_NONE;
  int shift = 0;
  // What counts little is no extreme, unless nothing else counts.
  ivec4 most = max(max(weights.a, weights.b), max(weights.c, weights.d));
  int least_weight = any(greaterThanEqual(most, ivec4(BC4_MUCH))) ? BC4_MUCH : 1;
  for (int is_six = 0; is_six < 2; is_six++) {
    ivec2 ra = bc4_row_range(values.a, weights.a, least_weight, is_six != 0);
    ivec2 rb = bc4_row_range(values.b, weights.b, least_weight, is_six != 0);
    ivec2 rc = bc4_row_range(values.c, weights.c, least_weight, is_six != 0);
    ivec2 rd = bc4_row_range(values.d, weights.d, least_weight, is_six != 0);
    int low = min(min(ra.x, rb.x), min(rc.x, rd.x));
    int high = max(max(ra.y, rb.y), max(rc.y, rd.y));
    if (is_six == 0) {
      while ((high - low) >> shift > 4095) {
        shift++;
      }
    }
    // Without such values, low is above high: all endpoints will do.
    int first = min(low, high) / BC4_STEP;
    int last = (max(low, high) + BC4_STEP - 1) / BC4_STEP;
    int size = max(1, (last - first) / 16);
    ivec2 middle = ivec2(first, last);
    uint middle_cost = BC4_NONE;
    for (int i = 0; i < 36; i++) {
      ivec3 ends = ivec3(first + (i % 6 - 1) * size, last - (i / 6 - 1) * size, is_six);
      uint cost = bc4_cost(values, weights, ends, shift);
      if (cost < middle_cost) {
        middle_cost = cost;
        middle = ends.xy;
      }
    }
    ivec2 around = middle;
    for (int turn = 0; turn < 6 && (turn == 0 || size > 1 || any(notEqual(around, middle))); turn++) {
      size = max(1, size / 2);
      around = middle;
      for (int i = 0; i < 9; i++) {
        ivec3 ends = ivec3(around + (ivec2(i % 3, i / 3) - 1) * size, is_six);
        uint cost = bc4_cost(values, weights, ends, shift);
        if (cost < middle_cost) {
          middle_cost = cost;
          middle = ends.xy;
        }
      }
    }
    if (middle_cost < least) {
      least = middle_cost;
      found = ivec3(middle, is_six);
    }
  }
  return found;
}

// The value of an index. ends: as bc4_search returns them.
int bc4_value(ivec3 ends, int index)
{
  if (ends.z != 0) {
    if (index >= 6) {
      return index == 6 ? 0 : BC4_ONE;
    }
    int part = index < 2 ? 5 * index : index - 1;
    return 56 * ((5 - part) * ends.x + part * ends.y);
  }
  int part = index < 2 ? 7 * index : index - 1;
  return 40 * ((7 - part) * ends.y + part * ends.x);
}

// The indices of the nearest values of four texels.
ivec4 bc4_row_indices(ivec4 values, ivec3 ends)
{
  ivec4 indices = ivec4(0);
  ivec4 least = abs(values - bc4_value(ends, 0));
  for (int index = 1; index < 8; index++) {
    ivec4 off = abs(values - bc4_value(ends, index));
    indices += ivec4(lessThan(off, least)) * (index - indices);
    least = min(least, off);
  }
  return indices;
}

Bc4Rows bc4_indices(Bc4Rows values, ivec3 ends)
{
  Bc4Rows indices;
  indices.a = bc4_row_indices(values.a, ends);
  indices.b = bc4_row_indices(values.b, ends);
  indices.c = bc4_row_indices(values.c, ends);
  indices.d = bc4_row_indices(values.d, ends);
  return indices;
}

ivec4 bc4_row_values(ivec4 indices, ivec3 ends)
{
  return ivec4(
    bc4_value(ends, indices.x), bc4_value(ends, indices.y), bc4_value(ends, indices.z), bc4_value(ends, indices.w)
  );
}

Bc4Rows bc4_values(Bc4Rows indices, ivec3 ends)
{
  Bc4Rows values;
  values.a = bc4_row_values(indices.a, ends);
  values.b = bc4_row_values(indices.b, ends);
  values.c = bc4_row_values(indices.c, ends);
  values.d = bc4_row_values(indices.d, ends);
  return values;
}

uint bc4_row_bits(ivec4 indices)
{
  uvec4 bits = uvec4(indices);
  return bits.x | (bits.y << 3) | (bits.z << 6) | (bits.w << 9);
}

// The eight bytes of a block, the first in the lowest bits.
uvec2 bc4_packed(ivec3 ends, Bc4Rows indices)
{
  uint first = uint(ends.z != 0 ? ends.x : ends.y);
  uint second = uint(ends.z != 0 ? ends.y : ends.x);
  uint low = bc4_row_bits(indices.a) | (bc4_row_bits(indices.b) << 12);
  uint high = bc4_row_bits(indices.c) | (bc4_row_bits(indices.d) << 12);
  return uvec2(first | (second << 8) | (low << 16), (low >> 16) | (high << 8));
}
