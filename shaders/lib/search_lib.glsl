// Searches the tree in the textures `nodes` and `corners` for a hit of one ray. mesh/spatial/bvh.py builds the tree; `grid_origin`,
// `grid_scale` and `first_leaf` belong to it.
//
// `beams` has, for each block of texels, what their rays can hit, in two texels: up to eight nodes of triangles, in order, with the
// number of the node + 1 above a bit for each of its triangles; then zeros. Or one node to start the walk from, without bits.
#include "lib/overlap_lib.glsl"
#include "lib/texture_lib.glsl"
#include "lib/tree_lib.glsl"

// Texels along each side of a block.
const int SEARCH_BLOCK = 4;
// The bits of an entry below the number of the node.
const int SEARCH_BITS = 4;

// The first triangle of a node in `beams`.
int search_leaf(uint entry)
{
  return (int(entry >> SEARCH_BITS) - 1) * 4 + 1 - first_leaf;
}

// The hit, as lib/hit_lib.glsl reads it, but with the distance from `origin` in w. Of the hits from `first` to `end`, it is the one
// nearest to `wanted`. facing: ignore triangles whose back faces the ray.
uvec4 search_hit(ivec2 texel, vec3 origin, vec3 direction, float first, float wanted, float end, bool facing)
{
  // In grid steps, boxes have integer coordinates. A zero component would give 0 * infinity for a ray inside a slab.
  vec3 grid_start = (origin - grid_origin.xyz) * grid_scale.xyz;
  vec3 grid_direction = direction * grid_scale.xyz;
  grid_direction = mix(grid_direction, vec3(1e-12), lessThan(abs(grid_direction), vec3(1e-12)));
  vec3 inverse = 1.0 / grid_direction;
  bvec3 forward = greaterThan(inverse, vec3(0.0));

  uvec4 listed = uvec4(1u << SEARCH_BITS, 0u, 0u, 0u), later = uvec4(0u);  // the root
  if (has_beams != 0) {
    ivec2 block = texel / SEARCH_BLOCK;
    listed = texel_at(beams, ivec2(block.x * 2, block.y));
    later = texel_at(beams, ivec2(block.x * 2 + 1, block.y));
  }
  uint triangles = listed.x & 15u;
  bool is_list = triangles != 0u;
  int node = is_list ? -1 : int(listed.x >> SEARCH_BITS) - 1;
  int leaf = search_leaf(listed.x);

  uvec4 hit = uvec4(0u);
  float best = 1e30;
  float from = first;
  float to = end;
  uvec2 trail = uvec2(0u);
  while (node >= 0 || triangles != 0u) {
    // Walk the tree until the ray hits a node of triangles. Triangles are tested outside this loop: inside it, lanes
    // that have found triangles would wait for the others at every step.
    while (node >= 0 && triangles == 0u) {
      uvec4 x = floatBitsToUint(texel_at(nodes, texture_place(node * 3)));
      uvec4 y = floatBitsToUint(texel_at(nodes, texture_place(node * 3 + 1)));
      uvec4 z = floatBitsToUint(texel_at(nodes, texture_place(node * 3 + 2)));
      vec4 x_low = (tree_low(x) - grid_start.x) * inverse.x;
      vec4 y_low = (tree_low(y) - grid_start.y) * inverse.y;
      vec4 z_low = (tree_low(z) - grid_start.z) * inverse.z;
      vec4 x_high = (tree_high(x) - grid_start.x) * inverse.x;
      vec4 y_high = (tree_high(y) - grid_start.y) * inverse.y;
      vec4 z_high = (tree_high(z) - grid_start.z) * inverse.z;
      // Select by the ray's direction instead of min and max: then the ray leaves a missing box before it enters it.
      vec4 enter = max(max(forward.x ? x_low : x_high, forward.y ? y_low : y_high),
                       max(forward.z ? z_low : z_high, vec4(from)));
      vec4 leave = min(min(forward.x ? x_high : x_low, forward.y ? y_high : y_low),
                       min(forward.z ? z_high : z_low, vec4(to)));
      uint mask = tree_mask(lessThanEqual(enter, leave));
      int child = node * 4 + 1;
      if (mask != 0u && child < first_leaf) {
        node = tree_down(node, mask, trail);
      }
      else {
        triangles = mask;
        leaf = child - first_leaf;
        node = tree_next(node, trail);
      }
    }
    while (triangles != 0u) {
      int triangle = leaf + findLSB(triangles);
      triangles &= triangles - 1u;
      if (is_list && triangles == 0u) {
        listed = uvec4(listed.yzw, later.x);
        later = uvec4(later.yzw, 0u);
        triangles = listed.x & 15u;
        leaf = search_leaf(listed.x);
      }
      vec3 corner = texel_at(corners, texture_place(triangle * 3)).xyz;
      vec3 edge1 = texel_at(corners, texture_place(triangle * 3 + 1)).xyz - corner;
      vec3 edge2 = texel_at(corners, texture_place(triangle * 3 + 2)).xyz - corner;
      // T. Möller and B. Trumbore, "Fast, minimum storage ray/triangle intersection" (1997).
      vec3 p = cross(direction, edge2);
      float determinant = dot(edge1, p);
      vec3 to_origin = origin - corner;
      vec3 q = cross(to_origin, edge1);
      vec3 solved = vec3(dot(to_origin, p), dot(direction, q), dot(edge2, q)) / determinant;
      float lever = sqrt(dot(to_origin, to_origin) * max(dot(edge1, edge1), dot(edge2, edge2)));
      float slack = overlap_slack(lever, determinant);
      bool inside_triangle = solved.x >= -slack && solved.y >= -slack && solved.x + solved.y <= 1.0 + slack;
      bool faces = determinant > 0.0 || !facing;
      float between = abs(solved.z - wanted);
      if (inside_triangle && faces && solved.z >= first && solved.z <= end && between < best) {
        best = between;
        from = max(first, wanted - best);
        to = min(end, wanted + best);
        hit = uvec4(uint(triangle) + 1u, floatBitsToUint(solved.x), floatBitsToUint(solved.y), floatBitsToUint(solved.z));
      }
    }
  }
  return hit;
}
