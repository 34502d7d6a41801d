// Walks a tree of mesh/bvh.py without a stack. The children of node n are 4 n + 1 to 4 n + 4. All walks are loops over
// TREE_BOXES, a mask of the children that they visit, and tree_step.

#include "lib/texture_lib.glsl"

// The boxes of a node's four children, in steps of the tree's grid. A missing child has low above high.
struct TreeBoxes {
  vec4 x_low, y_low, z_low, x_high, y_high, z_high;
};

// Unpacks the two numbers of 15 bits from the bits of each float (bvh.pack).
TreeBoxes tree_boxes(vec4 x, vec4 y, vec4 z)
{
  uvec4 x_bits = floatBitsToUint(x), y_bits = floatBitsToUint(y), z_bits = floatBitsToUint(z);
  TreeBoxes result;  // no constructor: Metal has none
  result.x_low = vec4(x_bits & 0x7fffu);
  result.y_low = vec4(y_bits & 0x7fffu);
  result.z_low = vec4(z_bits & 0x7fffu);
  result.x_high = vec4(x_bits >> 15);
  result.y_high = vec4(y_bits >> 15);
  result.z_high = vec4(z_bits >> 15);
  return result;
}

// The boxes of a node of the tree in the texture `nodes`. A macro: functions cannot take images.
#define TREE_BOXES(nodes, node) \
  tree_boxes(texel_at(nodes, texture_place((node)*3)), \
             texel_at(nodes, texture_place((node)*3 + 1)), \
             texel_at(nodes, texture_place((node)*3 + 2)))

// A bit for each of the four children.
uint tree_mask(bvec4 boxes)
{
  return (boxes.x ? 1u : 0u) | (boxes.y ? 2u : 0u) | (boxes.z ? 4u : 0u) | (boxes.w ? 8u : 0u);
}

// The first child of `mask`. `trail` holds four bits per level, deepest first: the siblings still to be visited.
int tree_down(int node, uint mask, inout uvec2 trail)
{
  trail = uvec2((trail.x << 4) | (mask & (mask - 1u)), (trail.y << 4) | (trail.x >> 28));
  return node * 4 + 1 + findLSB(mask);
}

// The node to visit after the subtree of `node`: a sibling of the node or of an ancestor. Returns -1 at the end.
int tree_next(int node, inout uvec2 trail)
{
  if (trail.x == 0u) {
    if (trail.y == 0u) {
      return -1;
    }
    trail = uvec2(trail.y, 0u);
    node = (node - 21845) >> 16;  // eight levels up: 21845 = (4^8 - 1) / 3
  }
  int levels = findLSB(trail.x) >> 2;
  int bits = levels * 4;
  if (levels > 0) {
    trail = uvec2((trail.x >> bits) | (trail.y << (32 - bits)), trail.y >> bits);
    node = (node - ((1 << (levels * 2)) - 1) / 3) >> (levels * 2);
  }
  int slot = findLSB(trail.x & 15u);
  trail.x &= trail.x - 1u;
  return ((node - 1) & ~3) + 1 + slot;
}

// One step of a walk, which starts at node 0 with a `trail` of zeros and ends when `node` is negative. mask: a bit for each child
// of `node` that the walk visits. leaves: the number of the first leaf. If the children are triangles, returns the mask; the first
// child is triangle `leaf` then.
uint tree_step(uint mask, int leaves, inout int node, inout uvec2 trail, inout int leaf)
{
  int child = node * 4 + 1;
  if (mask != 0u && child < leaves) {
    node = tree_down(node, mask, trail);
    return 0u;
  }
  leaf = child - leaves;
  node = tree_next(node, trail);
  return mask;
}

// A bit for each box that is closer to a point than the square root of `best`. `point` is in grid steps, `unit` the length of a step.
uint tree_closer(TreeBoxes boxes, vec3 point, vec3 unit, float best)
{
  vec4 dx = max(max(boxes.x_low - point.x, point.x - boxes.x_high), vec4(0.0)) * unit.x;
  vec4 dy = max(max(boxes.y_low - point.y, point.y - boxes.y_high), vec4(0.0)) * unit.y;
  vec4 dz = max(max(boxes.z_low - point.z, point.z - boxes.z_high), vec4(0.0)) * unit.z;
  vec4 squared = dx * dx + dy * dy + dz * dz;
  squared = mix(squared, vec4(1e30), greaterThan(boxes.x_low, boxes.x_high));  // missing children
  return tree_mask(lessThan(squared, vec4(best)));
}
