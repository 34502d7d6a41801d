// Writes, for each block of texels, what all its rays together can hit, as lib/search_lib.glsl reads it: so that their own walks
// need not start at the root.
#include "lib/block_lib.glsl"
#include "lib/texture_lib.glsl"
#include "lib/tree_lib.glsl"

// As in lib/search_lib.glsl.
const int BEAMS_BLOCK = 4;
const int BEAMS_BITS = 4;
// The most nodes of triangles in a list.
const int BEAMS_MOST = 8;

// Shortens the part of the rays from `enter` to `leave` to where they can be between two planes across an axis, for four pairs of
// planes. low, high: how far the planes are from the rays that begin closest to them. to_low, to_high: one over the direction of
// the rays that go there the fastest, or away from there the slowest.
void beams_clip(vec4 low, vec4 high, float to_low, float to_high, inout vec4 enter, inout vec4 leave)
{
  vec4 reach_low = low * to_low, reach_high = high * to_high;
  enter = max(enter, max(to_low > 0.0 ? reach_low : vec4(0.0), to_high < 0.0 ? reach_high : vec4(0.0)));
  leave = min(leave, min(to_low < 0.0 ? reach_low : vec4(1e30), to_high > 0.0 ? reach_high : vec4(1e30)));
}

void main()
{
  ivec2 block = block_texel(first_row);
  ivec2 size = texel_size(positions);
  if (any(greaterThanEqual(block * BEAMS_BLOCK, size))) {
    return;
  }
  // The ranges, along each axis, of where the rays begin, and of their directions.
  vec3 begin_least = vec3(1e30), begin_most = vec3(-1e30), least = vec3(1e30), most = vec3(-1e30);
  float end = -1.0;
  for (int i = 0; i < BEAMS_BLOCK * BEAMS_BLOCK; i++) {
    ivec2 texel = block * BEAMS_BLOCK + ivec2(i % BEAMS_BLOCK, i / BEAMS_BLOCK);
    vec4 below = texel_at(positions, min(texel, size - 1));
    vec4 away = texel_at(directions, min(texel, size - 1));
    if (below.a > 0.0) {
      vec3 begin = (below.xyz + away.xyz * away.w - grid_origin.xyz) * grid_scale.xyz;
      vec3 direction = -away.xyz * grid_scale.xyz;
      begin_least = min(begin_least, begin);
      begin_most = max(begin_most, begin);
      least = min(least, direction);
      most = max(most, direction);
      end = max(end, min(max_t, away.w + inside));
    }
  }
  least = mix(least, vec3(1e-12), lessThan(abs(least), vec3(1e-12)));
  most = mix(most, vec3(1e-12), lessThan(abs(most), vec3(1e-12)));
  vec3 to_high = 1.0 / least, to_low = 1.0 / most;

  uvec4 listed = uvec4(0u), later = uvec4(0u);
  int count = 0, shared_node = 0;  // the deepest node that has all they can hit
  uvec2 trail = uvec2(0u);
  int node = end < 0.0 ? -1 : 0;
  while (node >= 0) {
    uvec4 x = floatBitsToUint(texel_at(nodes, texture_place(node * 3)));
    uvec4 y = floatBitsToUint(texel_at(nodes, texture_place(node * 3 + 1)));
    uvec4 z = floatBitsToUint(texel_at(nodes, texture_place(node * 3 + 2)));
    vec4 enter = vec4(0.0), leave = vec4(end);
    beams_clip(tree_low(x) - begin_most.x, tree_high(x) - begin_least.x, to_low.x, to_high.x, enter, leave);
    beams_clip(tree_low(y) - begin_most.y, tree_high(y) - begin_least.y, to_low.y, to_high.y, enter, leave);
    beams_clip(tree_low(z) - begin_most.z, tree_high(z) - begin_least.z, to_low.z, to_high.z, enter, leave);
    // Missing children have low above high.
    uint mask = tree_mask(lessThanEqual(enter, leave)) & tree_mask(lessThanEqual(tree_low(x), tree_high(x)));
    int child = node * 4 + 1;
    if (mask != 0u && child < first_leaf) {
      node = tree_down(node, mask, trail);
      shared_node = count == 0 && (trail.x | trail.y) == 0u ? node : shared_node;
    }
    else {
      if (mask != 0u) {
        uint entry = (uint(node + 1) << BEAMS_BITS) | mask;
        listed |= entry * uvec4(equal(ivec4(count), ivec4(0, 1, 2, 3)));
        later |= entry * uvec4(equal(ivec4(count), ivec4(4, 5, 6, 7)));
        count++;
      }
      node = count > BEAMS_MOST ? -1 : tree_next(node, trail);
    }
  }
  if (count > BEAMS_MOST) {
    listed = uvec4(uint(shared_node + 1) << BEAMS_BITS, 0u, 0u, 0u);
    later = uvec4(0u);
  }
  imageStore(beams, ivec2(block.x * 2, block.y), listed);
  imageStore(beams, ivec2(block.x * 2 + 1, block.y), later);
}
