// Counts the layers of the low mesh along a ray.
#include "lib/owner_lib.glsl"
#include "lib/search_lib.glsl"

// Layers this close to the texel, in local space, are its own one.
const float ORDER_SAME = 1e-5;
// The most layers that count.
const int ORDER_MOST = 16;

// The layers of the low mesh that face a ray, from its origin to `end`. x: how many there are, with that of the texel, at `start`.
// y: how many the ray crosses before that one. Both are 0 if no turns are left.
ivec2 order_layers(vec3 origin, vec3 direction, float start, float end, inout int turns)
{
  vec3 grid_start = (origin - low_origin.xyz) * low_scale.xyz;
  vec3 inverse = search_inverse(direction, low_scale.xyz);
  ivec2 layers = ivec2(1, 0);
  uvec2 trail = uvec2(0u);
  int node = 0;
  while (node >= 0 && turns > 0) {
    turns -= TURNS_OF_VISIT;
    uint triangles = 0u;
    int leaf = 0;
    while (node >= 0 && triangles == 0u && turns > 0) {
      turns--;
      uint mask = search_boxes(TREE_BOXES(low_nodes, node), grid_start, inverse, 0.0, end);
      triangles = tree_step(mask, low_first_leaf, node, trail, leaf);
    }
    while (triangles != 0u) {
      OwnerTriangle here = owner_triangle(leaf + findLSB(triangles));
      triangles &= triangles - 1u;
      turns--;
      vec3 edge1 = here.b - here.a, edge2 = here.c - here.a;
      vec3 p = cross(direction, edge2);
      float determinant = dot(edge1, p);
      if (determinant > OVERLAP_FLAT) {
        vec3 to_origin = origin - here.a;
        vec3 q = cross(to_origin, edge1);
        vec3 solved = vec3(dot(to_origin, p), dot(direction, q), dot(edge2, q)) / determinant;
        bool crosses = solved.x >= 0.0 && solved.y >= 0.0 && solved.x + solved.y <= 1.0 && solved.z >= 0.0 && solved.z <= end;
        if (crosses && abs(solved.z - start) > ORDER_SAME) {
          layers += ivec2(1, solved.z < start ? 1 : 0);
        }
      }
    }
  }
  return node < 0 ? layers : ivec2(0);
}
