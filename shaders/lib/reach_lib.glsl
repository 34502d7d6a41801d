// How far rays reach through the tree in the textures `nodes`, `triangles` and `points` before they meet a triangle.
// mesh/bvh.py builds the tree; `grid_origin`, `grid_scale` and `first_leaf` belong to it.
//
// Four rays from one point go together: most nodes and triangles that they visit are the same, and are read once for all four.
// A vector `x`, `y` or `z` has one coordinate of the four directions.
#include "lib/overlap_lib.glsl"
#include "lib/tree_lib.glsl"
#include "lib/triangle_lib.glsl"
#include "lib/turns_lib.glsl"

const int REACH_RAYS = 4;

// Which sides of triangles a ray meets, as bits.
const int REACH_FRONTS = 1;
const int REACH_BACKS = 2;
const int REACH_BOTH = 3;

// Rays start on a surface, where rounding may have moved them behind a triangle that touches it: they begin this much earlier,
// in units of the tree's space, whose radius is about 1.
const float REACH_ROUNDING = 1e-6;
// Rays that meet both sides start as far off their own triangle, and so do not meet the back of its neighbors.
const float REACH_OFFSET = 2e-6;

// One over a direction in grid steps. A zero component would give 0 * infinity for a ray inside a slab.
vec3 reach_inverse(vec3 direction)
{
  return 1.0 / mix(direction, vec3(1e-12), lessThan(abs(direction), vec3(1e-12)));
}

// A bit for each of the four boxes of a node, relative to the start of a ray, that the ray crosses before `to`.
uint reach_crossed(TreeBoxes boxes, vec3 inverse, float to)
{
  // Select by the ray's direction instead of min and max: then the ray leaves a missing box before it enters it.
  bvec3 forward = greaterThan(inverse, vec3(0.0));
  vec4 enter = max(max((forward.x ? boxes.x_low : boxes.x_high) * inverse.x,
                       (forward.y ? boxes.y_low : boxes.y_high) * inverse.y),
                   max((forward.z ? boxes.z_low : boxes.z_high) * inverse.z, vec4(-REACH_ROUNDING)));
  vec4 leave = min(min((forward.x ? boxes.x_high : boxes.x_low) * inverse.x,
                       (forward.y ? boxes.y_high : boxes.y_low) * inverse.y),
                   min((forward.z ? boxes.z_high : boxes.z_low) * inverse.z, vec4(to)));
  return tree_mask(lessThanEqual(enter, leave));
}

// The distance to a triangle that a ray meets before `to`, or `to`. The other vectors are cross products of the triangle's
// edges and the way from its first corner to the start of the ray.
float reach_triangle(vec3 direction, vec3 across, vec3 for_u, vec3 for_v, float height, float lever, int sides, float to)
{
  float determinant = dot(direction, across);
  vec3 solved = vec3(dot(direction, for_u), dot(direction, for_v), height) / determinant;
  float slack = overlap_slack(lever, determinant);
  bool is_inside = abs(determinant) > OVERLAP_FLAT && solved.x >= -slack && solved.y >= -slack &&
                   solved.x + solved.y <= 1.0 + slack;
  bool is_close = solved.z >= -REACH_ROUNDING && solved.z < to;
  int side = determinant > 0.0 ? REACH_FRONTS : REACH_BACKS;
  return is_inside && is_close && (side & sides) != 0 ? solved.z : to;
}

// A walk of four rays: as tree_step takes it, and where each ray ends so far. It is under way while `node` is 0 or more.
struct ReachWalk {
  int node;
  uvec2 trail;
  vec4 to;
};

// Starts, unless a walk is under way, and walks until the end, or until no turns are left. Returns the distances to the nearest
// triangles with one of these sides, or `farthest` where none is closer; a ray with a negative `farthest` meets nothing, and its
// distance is 0. own: the triangle that the rays start from, which they do not meet, or -1. is_any: any triangle will do, not only
// the nearest, and the distance to it is 0.
vec4 reach_distances(vec3 origin, vec4 x, vec4 y, vec4 z, vec4 farthest, int own, int sides, bool is_any,
                     inout ReachWalk walk, inout int turns)
{
  // In grid steps, boxes have integer coordinates.
  vec3 start = (origin - grid_origin.xyz) * grid_scale.xyz;
  vec3 inverse0 = reach_inverse(vec3(x.x, y.x, z.x) * grid_scale.xyz);
  vec3 inverse1 = reach_inverse(vec3(x.y, y.y, z.y) * grid_scale.xyz);
  vec3 inverse2 = reach_inverse(vec3(x.z, y.z, z.z) * grid_scale.xyz);
  vec3 inverse3 = reach_inverse(vec3(x.w, y.w, z.w) * grid_scale.xyz);
  bool is_new = walk.node < 0;
  vec4 to = is_new ? farthest : walk.to;
  uvec2 trail = is_new ? uvec2(0u) : walk.trail;
  int node = max(walk.node, 0);
  uint found = 0u;
  int leaf = 0;
  while ((node >= 0 && turns > 0) || found != 0u) {
    turns -= TURNS_OF_VISIT;
    // Triangles are tested outside this loop: inside it, lanes that have found triangles would wait for the others.
    while (node >= 0 && found == 0u && turns > 0) {
      turns--;
      TreeBoxes boxes = TREE_BOXES(nodes, node);
      boxes.x_low -= start.x;
      boxes.y_low -= start.y;
      boxes.z_low -= start.z;
      boxes.x_high -= start.x;
      boxes.y_high -= start.y;
      boxes.z_high -= start.z;
      // No loop: drivers that do not unroll it select components at each turn.
      uint mask = reach_crossed(boxes, inverse0, to.x) | reach_crossed(boxes, inverse1, to.y) |
                  reach_crossed(boxes, inverse2, to.z) | reach_crossed(boxes, inverse3, to.w);
      found = tree_step(mask, first_leaf, node, trail, leaf);
    }
    int triangle = 0;
    uint asked = 0u;  // which of the rays meet a triangle that may be clear
    vec3 across = vec3(0.0), for_u = vec3(0.0), for_v = vec3(0.0);
    vec4 before = vec4(0.0);
    while (found != 0u && asked == 0u) {
      triangle = leaf + findLSB(found);
      found &= found - 1u;
      turns--;
      vec4 texel_of_it = texel_at(triangles, texture_place(triangle));
      ivec3 vertices = triangle_numbers(texel_of_it);
      TriangleEdges edges = TRIANGLE_EDGES(points, vertices);
      vec3 edge1 = edges.edge1, edge2 = edges.edge2;
      // T. Möller and B. Trumbore, "Fast, minimum storage ray/triangle intersection" (1997), in the order that leaves most
      // of the work to all four rays together.
      vec3 to_origin = origin - edges.corner;
      across = cross(edge2, edge1);
      for_u = cross(edge2, to_origin);
      for_v = cross(to_origin, edge1);
      float height = dot(edge2, for_v);
      float lever = sqrt(dot(to_origin, to_origin) * max(dot(edge1, edge1), dot(edge2, edge2)));
      int met = triangle == own ? 0 : sides;
      before = to;
      to.x = reach_triangle(vec3(x.x, y.x, z.x), across, for_u, for_v, height, lever, met, to.x);
      to.y = reach_triangle(vec3(x.y, y.y, z.y), across, for_u, for_v, height, lever, met, to.y);
      to.z = reach_triangle(vec3(x.z, y.z, z.z), across, for_u, for_v, height, lever, met, to.z);
      to.w = reach_triangle(vec3(x.w, y.w, z.w), across, for_u, for_v, height, lever, met, to.w);
#ifdef CUTOUTS
      asked = cutout_may_be(texel_of_it) ? tree_mask(lessThan(to, before)) : 0u;
#endif
      if (is_any) {
        to = mix(to, vec4(-1.0), lessThan(to, before));
      }
    }
#ifdef CUTOUTS
    while (asked != 0u) {  // ray after ray: software would look there for all four each time
      turns--;
      bvec4 is_one = equal(ivec4(findLSB(asked)), ivec4(0, 1, 2, 3));
      vec4 one = vec4(is_one);
      asked &= asked - 1u;
      vec3 direction = vec3(dot(one, x), dot(one, y), dot(one, z));
      vec2 weights = vec2(dot(direction, for_u), dot(direction, for_v)) / dot(direction, across);
      float is_clear = cutout_hides_nothing(triangle, weights) ? 1.0 : 0.0;
      to = mix(to, before, greaterThan(one * is_clear, vec4(0.5)));
    }
#endif
    if (is_any && max(max(to.x, to.y), max(to.z, to.w)) < 0.0) {
      node = -1;  // all rays are blocked
      found = 0u;
    }
  }
  walk.node = node;
  walk.trail = trail;
  walk.to = to;
  return max(to, vec4(0.0));
}
