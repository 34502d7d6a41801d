// Writes the clearance of each triangle of the low mesh, as owner_lib.glsl reads it: a hit that is closer to its texel than half
// of it belongs to the texel, without a search.
#include "lib/owner_lib.glsl"

// How far the search goes, in radii of the triangle: it takes longer for larger ones.
const float CLEARANCE_RADII = 1.5;
// The most triangles that it tests, as around the center of a fan: beyond, the clearance is 0, and hits are searched for.
const int CLEARANCE_MOST = 256;

void main()
{
  // Texels that run together, 4 x 4 of them, have triangles that follow each other: their searches take similar paths.
  ivec2 place = ivec2(gl_FragCoord.xy);
  int own = (((place.y >> 2) * per_row + (place.x >> 2)) << 4) + ((place.y & 3) << 2) + (place.x & 3);
  if (own >= count) {
    discard;
  }
  OwnerTriangle here = owner_triangle(own);
  vec3 center = (here.a + here.b + here.c) / 3.0;
  float radius = max(length(here.a - center), max(length(here.b - center), length(here.c - center)));
  float best = CLEARANCE_RADII * CLEARANCE_RADII * radius * radius;
  vec3 grid_point = (center - low_origin.xyz) * low_scale.xyz;
  vec3 unit = 1.0 / low_scale.xyz;
  uvec2 trail = uvec2(0u);
  int node = 0;
  int tested = 0;
  int turns = TURNS_MOST;
  while (node >= 0 && tested < CLEARANCE_MOST && turns > 0) {
    turns--;
    int leaf = 0;
    uint triangles = tree_step(
        tree_closer(TREE_BOXES(low_nodes, node), grid_point, unit, best), low_first_leaf, node, trail, leaf);
    while (triangles != 0u) {
      int triangle = leaf + findLSB(triangles);
      triangles &= triangles - 1u;
      tested++;
      OwnerTriangle other = owner_triangle(triangle);
      vec3 closest = closest_on_triangle(center, other.a, other.b, other.c, other.face);
      vec3 to_closest = closest - center;
      float squared = dot(to_closest, to_closest);
      bool may_agree = dot(other.face, here.face) > -OWNER_ALIKE * length(other.face) * length(here.face);
      if (triangle != own && may_agree && squared < best && !owner_walk_reaches(own, triangle, closest)) {
        best = squared;
      }
    }
  }
  float clearance = node < 0 ? max(0.0, sqrt(best) - radius) : 0.0;
  clearance_out = vec4(clearance, 0.0, 0.0, 0.0);
}
