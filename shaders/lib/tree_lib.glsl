// Walks a tree of mesh/spatial/bvh.py without a stack. The children of node n are 4 n + 1 to 4 n + 4.

// Unpack the two numbers of 15 bits from the bits of a float (bvh.pack).
vec4 tree_low(uvec4 bits)
{
  return vec4(bits & 0x7fffu);
}

vec4 tree_high(uvec4 bits)
{
  return vec4(bits >> 15);
}

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

// The squared distances from a point to the four boxes of a node. `point` is in grid steps, `unit` the length of a step.
vec4 tree_distances(uvec4 x, uvec4 y, uvec4 z, vec3 point, vec3 unit)
{
  vec4 dx = max(max(tree_low(x) - point.x, point.x - tree_high(x)), vec4(0.0)) * unit.x;
  vec4 dy = max(max(tree_low(y) - point.y, point.y - tree_high(y)), vec4(0.0)) * unit.y;
  vec4 dz = max(max(tree_low(z) - point.z, point.z - tree_high(z)), vec4(0.0)) * unit.z;
  vec4 squared = dx * dx + dy * dy + dz * dz;
  return mix(squared, vec4(1e30), greaterThan(tree_low(x), tree_high(x)));  // missing children
}
