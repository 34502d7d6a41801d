// How far a ray reaches through the tree in the textures `nodes` and `corners` before it meets a triangle.
// mesh/spatial/bvh.py builds the tree; `grid_origin`, `grid_scale` and `first_leaf` belong to it.
#include "lib/texture_lib.glsl"
#include "lib/tree_lib.glsl"

// Which sides of triangles a ray meets, as bits.
const int REACH_FRONTS = 1;
const int REACH_BACKS = 2;
const int REACH_BOTH = 3;

// Rays start on a surface, where rounding may have moved them behind a triangle that touches it: they begin this much earlier,
// in units of the tree's space, whose radius is about 1.
const float REACH_ROUNDING = 1e-6;
// Rays that meet both sides start as far off their own triangle, and so do not meet the back of its neighbors.
const float REACH_OFFSET = 2e-6;
// Neighboring triangles overlap by as much as in cast_comp.glsl.
const float REACH_EDGE = 1e-5;
const float REACH_SINGLE = 4e-7;
const float REACH_MOST = 1e-3;

// The distance to the nearest triangle with one of these sides, or `farthest` if none is closer. own: the triangle that the
// ray starts from, which it does not meet, or -1. is_any: any triangle will do, not only the nearest.
float reach_distance(vec3 origin, vec3 direction, float farthest, int own, int sides, bool is_any)
{
  // In grid steps, boxes have integer coordinates. A zero component would give 0 * infinity for a ray inside a slab.
  vec3 grid_start = (origin - grid_origin.xyz) * grid_scale.xyz;
  vec3 grid_direction = direction * grid_scale.xyz;
  grid_direction = mix(grid_direction, vec3(1e-12), lessThan(abs(grid_direction), vec3(1e-12)));
  vec3 inverse = 1.0 / grid_direction;
  bvec3 forward = greaterThan(inverse, vec3(0.0));
  float to = farthest;
  uvec2 trail = uvec2(0u);
  int node = 0;
  while (node >= 0) {
    uint triangles = 0u;
    int leaf = 0;
    // Triangles are tested outside this loop: inside it, lanes that have found triangles would wait for the others.
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
                       max(forward.z ? z_low : z_high, vec4(-REACH_ROUNDING)));
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
      float slack = REACH_EDGE + min(REACH_SINGLE * lever / abs(determinant), REACH_MOST);
      bool is_inside = solved.x >= -slack && solved.y >= -slack && solved.x + solved.y <= 1.0 + slack;
      int side = determinant > 0.0 ? REACH_FRONTS : REACH_BACKS;
      if (is_inside && (side & sides) != 0 && triangle != own && solved.z >= -REACH_ROUNDING && solved.z < to) {
        to = solved.z;
        if (is_any) {
          triangles = 0u;
          node = -1;
        }
      }
    }
  }
  return max(to, 0.0);
}
