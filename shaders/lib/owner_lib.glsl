// Whether a hit belongs to a texel: whether the point of the low mesh closest to the hit is reached from the texel by a short
// walk over the low mesh.
#include "lib/closest_lib.glsl"
#include "lib/tree_lib.glsl"
#include "lib/turns_lib.glsl"

// The most triangles that the walk crosses.
const int OWNER_STEPS = 12;
// The share of a squared distance by which another triangle must be closer. Rounding differs by less between neighbors.
const float OWNER_CLOSER = 1.0 - 1e-5;
// Points this close, in local space, are the same.
const float OWNER_SAME = 1e-6;
// The least distance of the closest point from the hit where the rule is strict, in distances of the texel.
const float OWNER_STRICT = 0.9;
// A triangle is folded back on another if their normals are more than 120 degrees apart.
const float OWNER_FOLDED = -0.5;
// A normal alike another is within 45 degrees of it. It does not agree with faces that are turned by 135 degrees or more.
const float OWNER_ALIKE = 0.70711;

struct OwnerTriangle {
  vec3 a, b, c;
  // The triangles across the edges from a, b and c to the next corner, or -1.
  ivec3 across;
  // A normal of any length.
  vec3 face;
};

OwnerTriangle owner_triangle(int triangle)
{
  vec4 a = texel_at(low_corners, texture_place(triangle * 4));
  vec4 b = texel_at(low_corners, texture_place(triangle * 4 + 1));
  vec4 c = texel_at(low_corners, texture_place(triangle * 4 + 2));
  OwnerTriangle result;  // no constructor: Metal has none
  result.a = a.xyz;
  result.b = b.xyz;
  result.c = c.xyz;
  result.across = ivec3(a.w, b.w, c.w);
  result.face = cross(b.xyz - a.xyz, c.xyz - a.xyz);
  return result;
}

// xyz: the face normal, of any length. w: no triangle is closer to this one than that, unless a short walk leads to it, or no
// normal alike this one agrees with it.
vec4 owner_clearance(int triangle)
{
  return texel_at(low_corners, texture_place(triangle * 4 + 3));
}

bool owner_has_corner(OwnerTriangle triangle, vec3 place)
{
  return all(equal(triangle.a, place)) || all(equal(triangle.b, place)) || all(equal(triangle.c, place));
}

bool owner_touches(OwnerTriangle one, OwnerTriangle other)
{
  return owner_has_corner(one, other.a) || owner_has_corner(one, other.b) || owner_has_corner(one, other.c);
}

// Whether a walk over the low mesh from triangle `current`, always across the edge beyond which `goal` lies farthest, ends on
// the triangle `last`, which holds `goal`, or on one that touches it and is not folded back on it.
bool owner_walk_reaches(int current, int last, vec3 goal)
{
  int before = -1;
  OwnerTriangle here;
  for (int steps = 0; steps < OWNER_STEPS; steps++) {
    here = owner_triangle(current);
    vec3 ab = cross(here.b - here.a, here.face);
    vec3 bc = cross(here.c - here.b, here.face);
    vec3 ca = cross(here.a - here.c, here.face);
    // How far `goal` lies beyond each edge.
    vec3 beyond = vec3(dot(ab, goal - here.a) / max(length(ab), 1e-30), dot(bc, goal - here.b) / max(length(bc), 1e-30),
                       dot(ca, goal - here.c) / max(length(ca), 1e-30));
    float most = max(beyond.x, max(beyond.y, beyond.z));
    int next = beyond.x == most ? here.across.x : beyond.y == most ? here.across.y : here.across.z;
    if (most <= OWNER_SAME || next < 0 || next == before) {
      break;
    }
    if (next == last) {
      return true;
    }
    before = current;
    current = next;
  }
  OwnerTriangle there = owner_triangle(last);
  return owner_touches(here, there) && dot(here.face, there.face) > OWNER_FOLDED * length(here.face) * length(there.face);
}

// Whether `triangle` faces the same way as `normal` and has a point closer to `point` than the square root of `best`. If so,
// `closest` is that point, and `best` gets smaller.
bool owner_is_closer(int triangle, vec3 point, vec3 normal, inout float best, inout vec3 closest)
{
  OwnerTriangle here = owner_triangle(triangle);
  vec3 found = closest_on_triangle(point, here.a, here.b, here.c, here.face);
  vec3 to_found = found - point;
  float squared = dot(to_found, to_found);
  if (dot(here.face, normal) <= 0.0 || squared >= best) {
    return false;
  }
  best = squared * OWNER_CLOSER;
  closest = found;
  return true;
}

// A search for the closest point under way: as tree_step takes it, with the point so far, its triangle, or -1, and a little less
// than its squared distance. It is under way while `node` is 0 or more.
struct OwnerWalk {
  int node;
  uvec2 trail;
  int found;
  vec3 closest;
  float best;
};

// Starts, unless a search is under way, and searches until the end, or until no turns are left: then the answer is false.
// point, normal: of the hit. below: the texel's point on the low mesh, on the triangle `own`. is_strict: the texel must be about
// the closest point itself.
bool owner_has_hit(vec3 point, vec3 normal, vec3 below, int own, bool is_strict, inout OwnerWalk walk, inout int turns)
{
  // Over a plane the texel's point is the closest one: rounding must not put the plane farther away than its point.
  float reach = length(below - point) + OWNER_SAME;
  bool is_new = walk.node < 0;
  int node = max(walk.node, 0);
  uvec2 trail = is_new ? uvec2(0u) : walk.trail;
  int found = walk.found;
  vec3 closest = walk.closest;
  float best = walk.best;
  if (is_new) {
    best = reach * reach;
    // The closest point is at most as far from the hit as the texel is, and so at most twice as far from the texel.
    vec4 clearance = owner_clearance(own);
    bool is_alike = dot(clearance.xyz, normal) > OWNER_ALIKE * length(clearance.xyz) * length(normal);
    if (!is_strict && is_alike && 4.0 * best < clearance.w * clearance.w) {
      return true;
    }
    closest = below;
    found = owner_is_closer(own, point, normal, best, closest) ? own : -1;
  }
  vec3 grid_point = (point - low_origin.xyz) * low_scale.xyz;
  vec3 unit = 1.0 / low_scale.xyz;
  while (node >= 0 && turns > 0) {
    turns -= TURNS_OF_VISIT;
    uint triangles = 0u;
    int leaf = 0;
    while (node >= 0 && triangles == 0u && turns > 0) {
      turns--;
      uint mask = tree_closer(TREE_BOXES(low_nodes, node), grid_point, unit, best);
      triangles = tree_step(mask, low_first_leaf, node, trail, leaf);
    }
    while (triangles != 0u) {
      int triangle = leaf + findLSB(triangles);
      triangles &= triangles - 1u;
      turns--;
      if (owner_is_closer(triangle, point, normal, best, closest)) {
        found = triangle;
      }
    }
  }
  walk.node = node;
  if (node >= 0) {
    walk.trail = trail;
    walk.found = found;
    walk.closest = closest;
    walk.best = best;
    return false;
  }
  turns -= OWNER_STEPS;
  vec3 to_closest = closest - point;
  if (is_strict && dot(to_closest, to_closest) < OWNER_STRICT * OWNER_STRICT * reach * reach) {
    return false;
  }
  return found >= 0 && (found == own || owner_walk_reaches(own, found, closest));
}
