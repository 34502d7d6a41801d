// Searches the tree in the textures `nodes`, `triangles` and `points` for a hit of one ray. mesh/bvh.py builds the tree; `grid_origin`,
// `grid_scale` and `first_leaf` belong to it.
#include "lib/overlap_lib.glsl"
#include "lib/packet_lib.glsl"
#include "lib/tree_lib.glsl"
#include "lib/triangle_lib.glsl"
#include "lib/turns_lib.glsl"

// A search under way: as tree_step takes it, with the hit so far. It has ended when `node` is negative.
struct SearchWalk {
  int node;
  uvec2 trail;
  uvec4 hit;
};

// The first triangle of a node in a packet's list.
int search_leaf(uint entry)
{
  return packet_node(entry) * 4 + 1 - first_leaf;
}

// One over the direction of a ray in grid steps, in which boxes have integer coordinates.
vec3 search_inverse(vec3 direction, vec3 scale)
{
  // A zero component would give 0 * infinity for a ray inside a slab.
  vec3 grid_direction = direction * scale;
  grid_direction = mix(grid_direction, vec3(1e-12), lessThan(abs(grid_direction), vec3(1e-12)));
  return 1.0 / grid_direction;
}

// A bit for each box that a ray crosses between two distances from `grid_start`. inverse: as search_inverse has it.
uint search_boxes(TreeBoxes boxes, vec3 grid_start, vec3 inverse, float from, float to)
{
  bvec3 forward = greaterThan(inverse, vec3(0.0));
  vec4 x_low = (boxes.x_low - grid_start.x) * inverse.x;
  vec4 y_low = (boxes.y_low - grid_start.y) * inverse.y;
  vec4 z_low = (boxes.z_low - grid_start.z) * inverse.z;
  vec4 x_high = (boxes.x_high - grid_start.x) * inverse.x;
  vec4 y_high = (boxes.y_high - grid_start.y) * inverse.y;
  vec4 z_high = (boxes.z_high - grid_start.z) * inverse.z;
  // Select by the ray's direction instead of min and max: then the ray leaves a missing box before it enters it.
  vec4 enter = max(max(forward.x ? x_low : x_high, forward.y ? y_low : y_high), max(forward.z ? z_low : z_high, vec4(from)));
  vec4 leave = min(min(forward.x ? x_high : x_low, forward.y ? y_high : y_low), min(forward.z ? z_high : z_low, vec4(to)));
  return tree_mask(lessThanEqual(enter, leave));
}

// Searches until the end, or until no turns are left. The hit is as lib/hit_lib.glsl reads it, but with the distance from `origin`
// in w. Of the hits from `first` to `end`, it is the one nearest to `wanted`. facing: ignore triangles whose back faces the ray.
// is_new: start, rather than go on with `walk`.
void search_hit(ivec2 texel, vec3 origin, vec3 direction, float first, float wanted, float end, bool facing, bool is_new,
                inout SearchWalk walk, inout int turns)
{
  vec3 grid_start = (origin - grid_origin.xyz) * grid_scale.xyz;
  vec3 inverse = search_inverse(direction, grid_scale.xyz);

  uvec4 listed = uvec4(packet_entry(0, 0u), 0u, 0u, 0u), later = uvec4(0u);  // the root
  if (has_packets != 0) {
    ivec2 place = packet_place(texel / PACKET_SIDE);
    listed = texelFetch(packets, place, 0);
    later = texelFetch(packets, place + ivec2(1, 0), 0);
  }
  uint found = is_new ? packet_triangles(listed.x) : 0u;
  bool is_list = found != 0u;
  int leaf = search_leaf(listed.x);
  int node = walk.node;
  uvec2 trail = walk.trail;
  uvec4 hit = walk.hit;
  if (is_new) {
    node = is_list ? -1 : packet_node(listed.x);
    trail = uvec2(0u);
    hit = uvec4(0u);
  }
  float best = hit.x != 0u ? abs(uintBitsToFloat(hit.w) - wanted) : 1e30;
  float from = max(first, wanted - best);
  float to = min(end, wanted + best);
  // A list has so few triangles that its search always ends.
  while ((node >= 0 && turns > 0) || found != 0u) {
    turns -= TURNS_OF_VISIT;
    // Walk the tree until the ray hits a node of triangles. Triangles are tested outside this loop: inside it, lanes
    // that have found triangles would wait for the others at every step.
    while (node >= 0 && found == 0u && turns > 0) {
      turns--;
      uint mask = search_boxes(TREE_BOXES(nodes, node), grid_start, inverse, from, to);
      found = tree_step(mask, first_leaf, node, trail, leaf);
    }
    while (found != 0u) {
      int triangle = leaf + findLSB(found);
      found &= found - 1u;
      turns--;
      if (is_list && found == 0u) {
        listed = uvec4(listed.yzw, later.x);
        later = uvec4(later.yzw, 0u);
        found = packet_triangles(listed.x);
        leaf = search_leaf(listed.x);
      }
      vec4 texel_of_it = texel_at(triangles, texture_place(triangle));
      ivec3 vertices = triangle_numbers(texel_of_it);
      TriangleEdges edges = TRIANGLE_EDGES(points, vertices);
      vec3 edge1 = edges.edge1, edge2 = edges.edge2;
      // T. Möller and B. Trumbore, "Fast, minimum storage ray/triangle intersection" (1997).
      vec3 p = cross(direction, edge2);
      float determinant = dot(edge1, p);
      vec3 to_origin = origin - edges.corner;
      vec3 q = cross(to_origin, edge1);
      vec3 solved = vec3(dot(to_origin, p), dot(direction, q), dot(edge2, q)) / determinant;
      float lever = sqrt(dot(to_origin, to_origin) * max(dot(edge1, edge1), dot(edge2, edge2)));
      float slack = overlap_slack(lever, determinant);
      bool inside_triangle = abs(determinant) > OVERLAP_FLAT && solved.x >= -slack && solved.y >= -slack &&
                             solved.x + solved.y <= 1.0 + slack;
      bool faces = determinant > 0.0 || !facing;
      float between = abs(solved.z - wanted);
      bool is_nearer = inside_triangle && faces && solved.z >= first && solved.z <= end && between < best;
#ifdef CUTOUTS
      turns--;
      bool asks = is_nearer && cutout_may_be(texel_of_it);
      while (asks) {  // no branch: software would look there for each triangle
        turns--;
        is_nearer = !cutout_hides_nothing(triangle, solved.xy);
        asks = false;
      }
#endif
      if (is_nearer) {
        best = between;
        from = max(first, wanted - best);
        to = min(end, wanted + best);
        hit = uvec4(uint(triangle) + 1u, floatBitsToUint(solved.x), floatBitsToUint(solved.y), floatBitsToUint(solved.z));
      }
    }
  }
  walk.node = node;
  walk.trail = trail;
  walk.hit = hit;
}
