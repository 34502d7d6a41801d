// Encodes blocks in one mode of BC7 and keeps those that are better than before. Endpoints begin on the principal axis of each
// subset. Least squares for the indices they get follow, then bits that end the endpoints, then single steps of each channel.
#include "lib/bc7_lib.glsl"
#include "lib/texture_lib.glsl"
#include "lib/triangle_lib.glsl"

// How many proposals come from least squares, the first from the axis.
const int BC7_SQUARES = 4;
// The squared error of a texel that is no larger than that of rounding to 8 bits: no other mode is tried.
const int BC7_ENOUGH = 3;
const int BC7_ENOUGH_COLOR = 16;
// What is seen has 10 bits where a texel shows it. Of brighter proposals, it is cut here.
const int BC7_MOST_SEEN = 2047;
// Weights of least squares have 6 bits, and 10 where a proposal is brighter than the texel.
const int BC7_MOST_WEIGHT = 1023;
const int EACH = 1, SHARED = 2;  // kinds of the bits that end endpoints

// The weights of the second endpoint, in 64ths.
#define BC7_WEIGHTS(indices, scale) (((indices) * (scale) + 2048) >> 12)

ivec4 bc7_whole(ivec4 levels, ivec4 bits)
{
  return (levels << (8 - bits)) | (levels >> (2 * bits - 8));
}

// The level closest to a color in quarters of steps, of those that end with `last`, which is -1 for all.
ivec4 bc7_level(ivec4 color, ivec4 bits, int last)
{
  ivec4 scaled = color * ((ivec4(1) << bits) - 1) * 257;
  if (last < 0) {
    return (scaled + 131072) >> 18;
  }
  ivec4 half_level = (scaled + (1 - last) * 262144) >> 19;
  return clamp(half_level, ivec4(0), (ivec4(1) << (bits - 1)) - 1) * 2 + last;
}

int bc7_off(ivec4 color, ivec4 level, ivec4 bits, ivec4 counts)
{
  ivec4 off = color - 4 * bc7_whole(level, bits);
  return bc7_dot(min(off * off, ivec4(65535)), counts);
}

// What is seen of four values between endpoints of 8 bits.
ivec4 bc7_seen_between(int low, int high, ivec4 weights_of_high, int is_curved, int shift)
{
  ivec4 color = (((64 - weights_of_high) * low + weights_of_high * high + 32) >> 6) << 2;
  return min(bc7_seen(color, ivec4(is_curved)) >> shift, ivec4(BC7_MOST_SEEN));
}

// Adds `bits` bits of a value to a block.
void bc7_put(inout uvec4 block, inout int at, uint value, int bits)
{
  uvec4 word = uvec4(equal(ivec4(at >> 5), ivec4(0, 1, 2, 3)));
  uvec4 next = uvec4(equal(ivec4((at >> 5) + 1), ivec4(0, 1, 2, 3)));
  int shift = at & 31;
  block |= word * (value << shift);
  block |= next * ((value >> 1) >> (31 - shift));
  at += bits;
}

// Four bits for each texel, of which the first is set where these bits are.
uvec2 bc7_nibbles(int mask)
{
  uvec2 result = uvec2(0u);
  for (int i = 0; i < 8; i++) {
    result |= uvec2(uint((mask >> i) & 1), uint((mask >> (i + 8)) & 1)) << (4 * i);
  }
  return result;
}

int bc7_index(uvec2 indices, int texel)
{
  return int(((texel < 8 ? indices.x : indices.y) >> (4 * (texel & 7))) & 15u);
}

void bc7_put_indices(inout uvec4 block, inout int at, uvec2 indices, int bits, ivec3 anchors)
{
  for (int i = 0; i < 16; i++) {
    bool is_anchor = i == anchors.x || i == anchors.y || i == anchors.z;
    bc7_put(block, at, uint(bc7_index(indices, i)), is_anchor ? bits - 1 : bits);
  }
}

void main()
{
  ivec2 block = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(block, texel_size(texels) / 4))) {
    return;
  }
  int mode = shape.x, subsets = shape.y, color_bits = shape.z, alpha_bits = shape.w;
  int kind = more.x, index_bits = more.y, second_bits = more.z, rank = more.w;
  int rotation = how.z, sweeps = how.w;
  int last_bit = kind != 0 ? 1 : 0;
  uint least = is_first != 0 ? 4294967295u : imageLoad(costs, block).x;

  // The texels, and what the squares of their errors count.
  // Weights are for axes and proposals. What an error costs is the square of the difference of what is seen.
  ivec4 colors[16];
  ivec4 seen[16];
  ivec4 counts[16];
  int weights_of[16];
  ivec4 is_curved = how.x * ivec4(1, 1, 1, 0);
  int heaviest = 0, all_weights = 0, is_opaque = 1;
  for (int i = 0; i < 16; i++) {
    ivec2 texel = block * 4 + ivec2(i & 3, i >> 2);
    ivec4 color = bc7_fixed(texel_at(texels, texel));
    if (how.y == 0) {
      color[3] = BC7_ONE;
    }
    is_opaque = color.w == BC7_ONE ? is_opaque : 0;
    colors[i] = color;
    weights_of[i] = bc7_weight(texel_at(weights, min(texel, texel_size(weights) - 1)).x);
    heaviest = max(heaviest, weights_of[i]);
    all_weights += weights_of[i];
  }
  all_weights = heaviest == 0 ? 16 * BC7_HEAVIEST : all_weights;
  uint enough = uint(all_weights * (how.x != 0 ? BC7_ENOUGH_COLOR : BC7_ENOUGH));
  if (least <= enough || (mode == 7 && is_opaque == 1)) {
    return;
  }
  if (rotation > 0) {
    is_curved[3] = is_curved[rotation - 1];
    is_curved[rotation - 1] = 0;
  }
  int full_channel = rotation > 0 ? rotation - 1 : 3;
  int largest = 1, most_seen = 1;
  for (int i = 0; i < 16; i++) {
    ivec4 color = colors[i];
    if (rotation > 0) {
      colors[i][3] = color[rotation - 1];
      colors[i][rotation - 1] = color.w;
      color = colors[i];
    }
    weights_of[i] = heaviest == 0 ? BC7_HEAVIEST : weights_of[i];  // where no texel counts, all do
    counts[i] = bc7_slopes(color, is_curved) * weights_of[i];
    largest = max(largest, bc7_largest(counts[i]));
    if (is_opaque == 1) {
      color[full_channel] = 0;
    }
    most_seen = max(most_seen, bc7_largest(bc7_seen(color, is_curved)));
  }
  int shift = max(bc7_length(largest) - 6, 0);
  int seen_shift = how.x == 0 ? 14 : max(bc7_length(most_seen) - 10, 0);
  for (int i = 0; i < 16; i++) {
    counts[i] = max(counts[i] >> shift, min(counts[i], ivec4(1)));
    if (is_opaque == 1) {
      counts[i][full_channel] = 0;
    }
    seen[i] = min(bc7_seen(colors[i], is_curved) >> seen_shift, ivec4(BC7_MOST_SEEN));
  }

  int partition_number = 0;
  ivec4 entry = ivec4(0);
  if (subsets > 1) {
    partition_number = int(texel_at(ranked, block)[rank]);
    vec4 found = texel_at(table, texture_place((subsets - 2) * 64 + partition_number));
    entry = ivec4(triangle_numbers(found), triangle_fourth(found));
  }

  // Parts that are encoded for themselves: subsets, or the colors and the channel with indices of its own.
  bool is_separate = second_bits > 0;
  ivec4 lows[3];
  ivec4 highs[3];
  uvec2 all_indices = uvec2(0u), second_indices = uvec2(0u);
  ivec4 bits = ivec4(ivec3(color_bits), max(alpha_bits, 4));
  ivec4 most_level = (ivec4(1) << bits) - 1;
  uint total = 0u;
  // The channel that is exactly 255 in blocks without alpha.
  ivec4 is_full = ivec4(0);
  if (is_opaque == 1 || alpha_bits == 0) {
    is_full[full_channel] = 1;
  }
  bool is_forced = is_opaque == 1 && kind == EACH && alpha_bits > 0;  // alpha ends with 1
  for (int part = 0; part < (is_separate ? 2 : subsets); part++) {
    bool is_second = is_separate && part == 1;
    int mask = 65535;
    if (subsets > 1) {
      mask = part == 0 ? 65535 & ~(entry.x | entry.y) : (part == 1 ? entry.x : entry.y);
    }
    ivec4 channels = !is_separate ? ivec4(1) : (is_second ? ivec4(0, 0, 0, 1) : ivec4(1, 1, 1, 0));
    ivec4 used = channels * (1 - is_full);
    bool has_fourth = is_separate ? is_second : how.y != 0;
    int of_index = is_second ? second_bits : index_bits;
    int scale = of_index == 4 ? 17476 : (of_index == 3 ? 37449 : 87381);
    int groups = of_index == 4 ? 4 : (of_index == 3 ? 2 : 1);

    // The principal axis.
    int weight_sum = 0;
    ivec4 middle = ivec4(0), channel_counts = ivec4(0);
    for (int i = 0; i < 16; i++) {
      ivec4 count = counts[i] * channels * ((mask >> i) & 1);
      int weight = bc7_sum(count);
      weight_sum += weight;
      middle += colors[i] * weight;
      channel_counts += count;
    }
    weight_sum = max(weight_sum, 1);
    middle = (middle + (weight_sum >> 1)) / weight_sum;
    Bc7Scatter scatter;
    scatter.diagonal = ivec4(0);
    scatter.beside = ivec4(0);
    scatter.last = ivec2(0);
    for (int i = 0; i < 16; i++) {
      int weight = (bc7_sum(counts[i] * channels) * ((mask >> i) & 1) + 3) >> 2;
      ivec4 off = (colors[i] - middle) * channels;
      ivec4 weighted = off * weight;
      scatter.diagonal += weighted * off;
      scatter.beside += weighted.xxxy * off.yzwz;
      scatter.last += weighted.yz * off.ww;
    }
    int down = max(bc7_length(bc7_largest(scatter.diagonal)) - 14, 0);
    scatter.diagonal >>= down;
    scatter.beside >>= down;
    scatter.last >>= down;
    ivec4 axis = bc7_direction(scatter, 9);
    int first = 0, last = 0;
    for (int i = 0; i < 16; i++) {
      int along = bc7_dot((colors[i] - middle) * channels, axis);
      if (((mask >> i) & 1) == 1 && bc7_sum(counts[i] * channels) > 0) {
        first = min(first, along);
        last = max(last, along);
      }
    }
    ivec4 squared = ivec4(max(bc7_dot(axis, axis) >> 2, 1));
    ivec4 wanted_low = clamp(middle + bc7_quotients(axis * (first >> 2), squared), ivec4(0), ivec4(BC7_ONE));
    ivec4 wanted_high = clamp(middle + bc7_quotients(axis * (last >> 2), squared), ivec4(0), ivec4(BC7_ONE));

    ivec4 kept_low = ivec4(0), kept_high = ivec4(0), best_low = ivec4(0), best_high = ivec4(0);
    uvec2 best_indices = uvec2(0u);
    uint least_cost = 4294967295u;
    int ends = kind == EACH ? 4 : (kind == SHARED ? 2 : 0);
    int of_sweep = is_second ? 4 : (!is_separate && alpha_bits > 0 && how.y != 0 ? 16 : 12);
    int attempts = BC7_SQUARES + ends + sweeps * of_sweep;
    for (int attempt = 0; attempt < attempts; attempt++) {
      // A proposal.
      ivec4 low, high;
      if (attempt < BC7_SQUARES + ends) {
        ivec4 from_low = attempt < BC7_SQUARES ? wanted_low : kept_low;
        ivec4 from_high = attempt < BC7_SQUARES ? wanted_high : kept_high;
        int end_low = -1, end_high = -1;
        if (kind != 0) {
          int number = attempt - BC7_SQUARES;
          end_low = number & 1;
          end_high = kind == SHARED ? end_low : number >> 1;
          if (number < 0) {
            int low_0 = bc7_off(from_low, bc7_level(from_low, bits, 0), bits, channel_counts);
            int low_1 = bc7_off(from_low, bc7_level(from_low, bits, 1), bits, channel_counts);
            int high_0 = bc7_off(from_high, bc7_level(from_high, bits, 0), bits, channel_counts);
            int high_1 = bc7_off(from_high, bc7_level(from_high, bits, 1), bits, channel_counts);
            end_low = low_1 < low_0 ? 1 : 0;
            end_high = high_1 < high_0 ? 1 : 0;
            if (kind == SHARED) {
              end_low = low_1 + high_1 < low_0 + high_0 ? 1 : 0;
              end_high = end_low;
            }
          }
          if (is_forced) {
            end_low = 1;
            end_high = 1;
          }
        }
        low = bc7_level(from_low, bits, end_low);
        high = bc7_level(from_high, bits, end_high);
      }
      else {
        int number = (attempt - BC7_SQUARES - ends) % of_sweep;
        int channel = is_second ? 3 : number >> 2;
        int change = ((number & 1) == 0 ? 1 : -1) * (1 + last_bit);
        ivec4 changes = change * ivec4(equal(ivec4(channel), ivec4(0, 1, 2, 3)));
        low = best_low + ((number & 2) == 0 ? changes : ivec4(0));
        high = best_high + ((number & 2) == 0 ? ivec4(0) : changes);
        ivec4 end_low = best_low & last_bit, end_high = best_high & last_bit;
        low = clamp(low, end_low, most_level - last_bit + end_low);
        high = clamp(high, end_high, most_level - last_bit + end_high);
      }
      low += (most_level - low) * is_full;
      high += (most_level - high) * is_full;
      ivec4 whole_low = bc7_whole(low, bits), whole_high = bc7_whole(high, bits);
      if (alpha_bits == 0) {
        whole_low[3] = 255;
        whole_high[3] = 255;
      }

      // What is seen of its colors, four in a vector.
      ivec4 red[4];
      ivec4 green[4];
      ivec4 blue[4];
      ivec4 fourth[4];
      for (int group = 0; group < groups; group++) {
        ivec4 w = BC7_WEIGHTS(ivec4(0, 1, 2, 3) + 4 * group, scale);
        if (!is_second) {
          red[group] = bc7_seen_between(whole_low.x, whole_high.x, w, is_curved.x, seen_shift);
          green[group] = bc7_seen_between(whole_low.y, whole_high.y, w, is_curved.y, seen_shift);
          blue[group] = bc7_seen_between(whole_low.z, whole_high.z, w, is_curved.z, seen_shift);
        }
        if (has_fourth) {
          fourth[group] = bc7_seen_between(whole_low.w, whole_high.w, w, is_curved.w, seen_shift);
        }
      }

      // The indices of least cost, and the sums for least squares.
      uint cost = 0u;
      uvec2 indices = uvec2(0u);
      ivec4 low_low = ivec4(0), low_high = ivec4(0), high_high = ivec4(0), to_low = ivec4(0), to_high = ivec4(0);
      for (int i = 0; i < 16; i++) {
        ivec4 color = seen[i];
        int is_in = (mask >> i) & 1;
        int near = BC7_MOST, index = 0;
        for (int group = 0; group < groups; group++) {
          ivec4 off = ivec4(0);
          if (!is_second) {
            ivec4 r = red[group] - color.x;
            ivec4 g = green[group] - color.y;
            ivec4 b = blue[group] - color.z;
            off = r * r + g * g + b * b;
          }
          if (has_fourth) {
            ivec4 a = fourth[group] - color.w;
            off += a * a;
          }
          int here = min(min(off.x, off.y), min(off.z, off.w));
          if (here < near) {
            near = here;
            index = 4 * group + (off.x == here ? 0 : (off.y == here ? 1 : (off.z == here ? 2 : 3)));
          }
        }
        near *= weights_of[i] * is_in;
        cost += uint(near);
        uint at = uint(index * is_in) << (4 * (i & 7));
        indices |= i < 8 ? uvec2(at, 0u) : uvec2(0u, at);
        if (attempt < BC7_SQUARES) {
          int w = BC7_WEIGHTS(index, scale);
          ivec4 shown = (((64 - w) * whole_low + w * whole_high + 32) >> 6) << 2;
          ivec4 off = colors[i] - shown;
          // The slope halfway is that of the line between both, as the curve is about a square.
          ivec4 count = (bc7_slopes((colors[i] + shown) >> 1, is_curved) * (weights_of[i] * is_in)) >> shift;
          count = clamp(count, ivec4(min(weights_of[i] * is_in, 1)), ivec4(BC7_MOST_WEIGHT)) * used;
          ivec4 low_count = count * (64 - w), high_count = count * w;
          low_low += low_count * (64 - w);
          low_high += low_count * w;
          high_high += high_count * w;
          to_low += low_count * off;
          to_high += high_count * off;
        }
      }
      if (cost < least_cost) {
        least_cost = cost;
        best_low = low;
        best_high = high;
        best_indices = indices;
        kept_low = attempt < BC7_SQUARES ? wanted_low : kept_low;
        kept_high = attempt < BC7_SQUARES ? wanted_high : kept_high;
      }
      if (attempt < BC7_SQUARES) {
        // Whole numbers of at most 31 bits: 11 of the matrix, 19 of the rest.
        int less = max(bc7_length(max(bc7_largest(low_low), bc7_largest(high_high))) - 11, 0);
        int rest_less = max(bc7_length(max(bc7_largest(abs(to_low)), bc7_largest(abs(to_high)))) - 19, 0);
        low_low >>= less;
        low_high >>= less;
        high_high >>= less;
        to_low >>= rest_less;
        to_high >>= rest_less;
        int up = 6 + rest_less - less;
        ivec4 divisor = (low_low * high_high - low_high * low_high) >> max(up, 0);
        ivec4 is_solved = ivec4(greaterThan(divisor, ivec4(0)));
        divisor = max(divisor, ivec4(1));
        ivec4 for_low = (high_high * to_low - low_high * to_high) >> max(-up, 0);
        ivec4 for_high = (low_low * to_high - low_high * to_low) >> max(-up, 0);
        wanted_low = clamp(4 * whole_low + is_solved * bc7_quotients(for_low, divisor), ivec4(0), ivec4(BC7_ONE));
        wanted_high = clamp(4 * whole_high + is_solved * bc7_quotients(for_high, divisor), ivec4(0), ivec4(BC7_ONE));
      }
    }
    total += least_cost;

    // The highest bit of the anchor's index is not stored: it has to be 0.
    int anchor = is_separate || part == 0 ? 0 : (part == 1 ? entry.z : entry.w);
    int most_index = (1 << of_index) - 1;
    if (2 * bc7_index(best_indices, anchor) > most_index) {
      ivec4 swapped = best_low;
      best_low = best_high;
      best_high = swapped;
      best_indices = bc7_nibbles(mask) * uint(most_index) - best_indices;
    }
    if (is_second) {
      lows[0][3] = best_low.w;
      highs[0][3] = best_high.w;
      second_indices = best_indices;
    }
    else {
      lows[part] = best_low;
      highs[part] = best_high;
      all_indices |= best_indices;
    }
  }
  if (total >= least) {
    return;
  }

  uvec4 packed_block = uvec4(0u);
  int at = 0;
  bc7_put(packed_block, at, 1u << mode, mode + 1);
  if (subsets > 1) {
    bc7_put(packed_block, at, uint(partition_number), mode == 0 ? 4 : 6);
  }
  if (is_separate) {
    bc7_put(packed_block, at, uint(rotation), 2);
  }
  bool is_turned = mode == 4 && index_bits == 3;  // colors have the longer indices
  if (mode == 4) {
    bc7_put(packed_block, at, is_turned ? 1u : 0u, 1);
  }
  for (int channel = 0; channel < (alpha_bits > 0 ? 4 : 3); channel++) {
    for (int subset = 0; subset < subsets; subset++) {
      bc7_put(packed_block, at, uint(lows[subset][channel] >> last_bit), bits[channel] - last_bit);
      bc7_put(packed_block, at, uint(highs[subset][channel] >> last_bit), bits[channel] - last_bit);
    }
  }
  for (int subset = 0; subset < subsets && kind != 0; subset++) {
    bc7_put(packed_block, at, uint(lows[subset].x & 1), 1);
    if (kind == EACH) {
      bc7_put(packed_block, at, uint(highs[subset].x & 1), 1);
    }
  }
  ivec3 anchors = ivec3(0, subsets > 1 ? entry.z : 0, subsets > 2 ? entry.w : 0);
  if (is_turned) {
    bc7_put_indices(packed_block, at, second_indices, second_bits, ivec3(0));
    bc7_put_indices(packed_block, at, all_indices, index_bits, ivec3(0));
  }
  else {
    bc7_put_indices(packed_block, at, all_indices, index_bits, anchors);
    if (is_separate) {
      bc7_put_indices(packed_block, at, second_indices, second_bits, ivec3(0));
    }
  }
  imageStore(blocks, block, packed_block);
  imageStore(costs, block, uvec4(total, 0u, 0u, 0u));
}
