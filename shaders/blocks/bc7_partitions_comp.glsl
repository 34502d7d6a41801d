// Writes which four partitions suit a block best, best first: those whose subsets lie closest to a line each.
#include "lib/bc7_lib.glsl"
#include "lib/texture_lib.glsl"
#include "lib/triangle_lib.glsl"

// Texels about a middle that is the same for all subsets: their weights, and sums of them and of their products.
struct Bc7Moments {
  int weight;
  ivec4 sum;
  Bc7Scatter products;
};

Bc7Moments bc7_none()
{
  Bc7Moments m;
  m.weight = 0;
  m.sum = ivec4(0);
  m.products.diagonal = ivec4(0);
  m.products.beside = ivec4(0);
  m.products.last = ivec2(0);
  return m;
}

Bc7Moments bc7_added(Bc7Moments m, ivec4 color, int weight)
{
  ivec4 weighted = color * weight;
  m.weight += weight;
  m.sum += weighted;
  m.products.diagonal += weighted * color;
  m.products.beside += weighted.xxxy * color.yzwz;
  m.products.last += weighted.yz * color.ww;
  return m;
}

Bc7Moments bc7_less(Bc7Moments m, Bc7Moments other)
{
  m.weight -= other.weight;
  m.sum -= other.sum;
  m.products.diagonal -= other.products.diagonal;
  m.products.beside -= other.products.beside;
  m.products.last -= other.products.last;
  return m;
}

// The scatter about the mean, which is rounded to whole numbers.
Bc7Scatter bc7_scatter(Bc7Moments m)
{
  ivec4 mean = bc7_quotients(m.sum, ivec4(max(m.weight, 1)));
  Bc7Scatter result = m.products;
  ivec4 rest = m.weight * mean - m.sum;
  result.diagonal += mean * (rest - m.sum);
  result.beside += mean.xxxy * rest.yzwz - m.sum.xxxy * mean.yzwz;
  result.last += mean.yz * rest.ww - m.sum.yz * mean.ww;
  return result;
}

// The squared distance to a line through the mean, about, and a part of that along it, since indices are steps.
int bc7_off_line(Bc7Scatter m, int shift)
{
  m.diagonal >>= shift;
  m.beside >>= shift;
  m.last >>= shift;
  ivec4 direction = bc7_direction(m, 8);
  int length_squared = bc7_dot(direction, direction) >> 6;
  int along = bc7_dot(direction, bc7_times(m, direction) >> 6) / max(length_squared, 1);
  return max(bc7_sum(m.diagonal) - along, 0) * 16 + along;
}

void main()
{
  ivec2 block = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  ivec2 size = texel_size(texels) / 4;
  if (any(greaterThanEqual(block, size))) {
    return;
  }
  ivec4 colors[16];
  int counts[16];
  ivec4 middle = ivec4(0);
  int all_counts = 0, heaviest = 0;
  for (int i = 0; i < 16; i++) {
    ivec2 texel = block * 4 + ivec2(i & 3, i >> 2);
    ivec4 color = bc7_fixed(texel_at(texels, texel));
    int count = bc7_weight(texel_at(weights, min(texel, texel_size(weights) - 1)).x);
    if (how.x != 0) {  // linear
      int alpha = color.w;
      color = bc7_linear(color) >> 14;
      color[3] = alpha;
    }
    if (how.y == 0) {
      color[3] = 0;
    }
    colors[i] = color;
    counts[i] = count;
    heaviest = max(heaviest, count);
  }
  for (int i = 0; i < 16; i++) {
    counts[i] = heaviest == 0 ? BC7_HEAVIEST : counts[i];
    middle += colors[i] * counts[i];
    all_counts += counts[i];
  }
  middle = (middle + (all_counts >> 1)) / max(all_counts, 1);
  Bc7Moments all_texels = bc7_none();
  for (int i = 0; i < 16; i++) {
    colors[i] -= middle;
    all_texels = bc7_added(all_texels, colors[i], counts[i]);
  }
  int shift = max(bc7_length(bc7_largest(all_texels.products.diagonal)) - 14, 0);
  uvec4 best = uvec4(0u);
  ivec4 least = ivec4(BC7_MOST);
  for (int number = 0; number < how.w; number++) {
    vec4 entry = texel_at(table, texture_place(how.z + number));
    ivec3 masks = triangle_numbers(entry);
    Bc7Moments second = bc7_none(), third = bc7_none();
    for (int i = 0; i < 16; i++) {
      second = bc7_added(second, colors[i], counts[i] * ((masks.x >> i) & 1));
      if (how.z > 0) {
        third = bc7_added(third, colors[i], counts[i] * ((masks.y >> i) & 1));
      }
    }
    int cost = bc7_off_line(bc7_scatter(bc7_less(bc7_less(all_texels, second), third)), shift);
    cost += bc7_off_line(bc7_scatter(second), shift);
    if (how.z > 0) {
      cost += bc7_off_line(bc7_scatter(third), shift);
    }
    uint place = uint(number);
    if (cost < least.x) {
      least = ivec4(cost, least.xyz);
      best = uvec4(place, best.xyz);
    }
    else if (cost < least.y) {
      least = ivec4(least.x, cost, least.yz);
      best = uvec4(best.x, place, best.yz);
    }
    else if (cost < least.z) {
      least = ivec4(least.xy, cost, least.z);
      best = uvec4(best.xy, place, best.z);
    }
    else if (cost < least.w) {
      least[3] = cost;
      best[3] = place;
    }
  }
  imageStore(ranked, block, best);
}
