// Packet traversal: writes, for each block of texels, what all its rays together can hit, as lib/packet_lib.glsl has it: so that
// their own walks need not start at the root.
#include "lib/block_lib.glsl"
#include "lib/packet_lib.glsl"
#include "lib/tree_lib.glsl"
#include "lib/turns_lib.glsl"

// The most nodes of triangles in a list.
const int PACKETS_MOST = 8;

// Shortens the part of the rays from `enter` to `leave` to where they can be between two planes across an axis, for four pairs of
// planes. low, high: how far the planes are from the rays that begin closest to them. to_low, to_high: one over the direction of
// the rays that go there the fastest, or away from there the slowest.
void packets_clip(vec4 low, vec4 high, float to_low, float to_high, inout vec4 enter, inout vec4 leave)
{
  vec4 reach_low = low * to_low, reach_high = high * to_high;
  enter = max(enter, max(to_low > 0.0 ? reach_low : vec4(0.0), to_high < 0.0 ? reach_high : vec4(0.0)));
  leave = min(leave, min(to_low < 0.0 ? reach_low : vec4(1e30), to_high > 0.0 ? reach_high : vec4(1e30)));
}

void main()
{
  ivec2 block = block_texel(first_row);
  ivec2 size = texel_size(positions);
  if (any(greaterThanEqual(block * PACKET_SIDE, size))) {
    return;
  }
  // The ranges, along each axis, of where the rays begin, and of their directions.
  vec3 begin_least = vec3(1e30), begin_most = vec3(-1e30), least = vec3(1e30), most = vec3(-1e30);
  float end = -1.0;
  for (int i = 0; i < PACKET_SIDE * PACKET_SIDE; i++) {
    ivec2 texel = block * PACKET_SIDE + ivec2(i % PACKET_SIDE, i / PACKET_SIDE);
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
  int turns = TURNS_MOST;
  while (node >= 0 && turns > 0) {
    turns--;
    TreeBoxes boxes = TREE_BOXES(nodes, node);
    vec4 enter = vec4(0.0), leave = vec4(end);
    packets_clip(boxes.x_low - begin_most.x, boxes.x_high - begin_least.x, to_low.x, to_high.x, enter, leave);
    packets_clip(boxes.y_low - begin_most.y, boxes.y_high - begin_least.y, to_low.y, to_high.y, enter, leave);
    packets_clip(boxes.z_low - begin_most.z, boxes.z_high - begin_least.z, to_low.z, to_high.z, enter, leave);
    uint mask = tree_mask(lessThanEqual(enter, leave)) & tree_mask(lessThanEqual(boxes.x_low, boxes.x_high));
    int here = node, leaf = 0;
    uint triangles = tree_step(mask, first_leaf, node, trail, leaf);
    if (triangles != 0u) {
      uint entry = packet_entry(here, triangles);
      listed |= entry * uvec4(equal(ivec4(count), ivec4(0, 1, 2, 3)));
      later |= entry * uvec4(equal(ivec4(count), ivec4(4, 5, 6, 7)));
      count++;
      node = count > PACKETS_MOST ? -1 : node;
    }
    else if (count == 0 && node >= 0 && (trail.x | trail.y) == 0u) {
      shared_node = node;
    }
  }
  if (count > PACKETS_MOST || node >= 0) {
    listed = uvec4(packet_entry(shared_node, 0u), 0u, 0u, 0u);
    later = uvec4(0u);
  }
  ivec2 place = packet_place(block);
  imageStore(packets, place, listed);
  imageStore(packets, place + ivec2(1, 0), later);
}
