// Whether a hit belongs to a texel: whether the point of the low mesh closest to the hit is reached from the texel by a short
// walk over the low mesh.

// The most triangles that the walk crosses.
const int OWNER_STEPS = 12;
// The share of a squared distance by which another triangle must be closer. Rounding differs by less between neighbors.
const float OWNER_CLOSER = 1.0 - 1e-5;
// Points this close, in local space, are the same.
const float OWNER_SAME = 1e-6;

// Corners of a triangle of the low mesh; w has the number of the triangle across the edge to the next corner, or -1.
void owner_triangle(int triangle, out vec4 a, out vec4 b, out vec4 c)
{
  a = texel_at(low_corners, texture_place(triangle * 3));
  b = texel_at(low_corners, texture_place(triangle * 3 + 1));
  c = texel_at(low_corners, texture_place(triangle * 3 + 2));
}

// The closest point to `point` on a triangle of the low mesh whose face normal agrees with `normal`; `best`, a squared distance,
// is made smaller, and the result is true, if it is closer than that.
bool owner_closer(int triangle, vec3 point, vec3 normal, inout float best, inout vec3 closest)
{
  vec4 a, b, c;
  owner_triangle(triangle, a, b, c);
  vec3 face = cross(b.xyz - a.xyz, c.xyz - a.xyz);
  if (!(dot(face, normal) > 0.0)) {
    return false;
  }
  vec3 found = closest_on_triangle(point, a.xyz, b.xyz, c.xyz, face);
  vec3 to_found = found - point;
  float squared = dot(to_found, to_found);
  if (!(squared < best)) {
    return false;
  }
  best = squared * OWNER_CLOSER;
  closest = found;
  return true;
}

// Whether a walk over the low mesh from triangle `current`, always across the edge beyond which `goal` lies farthest, ends on
// the triangle `last`, which holds `goal`.
bool owner_walk_reaches(int current, int last, vec3 goal)
{
  int before = -1;
  for (int steps = 0; steps < OWNER_STEPS; steps++) {
    vec4 a, b, c;
    owner_triangle(current, a, b, c);
    vec3 face = cross(b.xyz - a.xyz, c.xyz - a.xyz);
    vec3 ab = cross(b.xyz - a.xyz, face), bc = cross(c.xyz - b.xyz, face), ca = cross(a.xyz - c.xyz, face);
    // How far `goal` lies beyond each edge.
    vec3 beyond = vec3(dot(ab, goal - a.xyz) / max(length(ab), 1e-30), dot(bc, goal - b.xyz) / max(length(bc), 1e-30),
                       dot(ca, goal - c.xyz) / max(length(ca), 1e-30));
    float most = max(beyond.x, max(beyond.y, beyond.z));
    int next = int(beyond.x == most ? a.w : beyond.y == most ? b.w : c.w);
    if (!(most > 0.0)) {  // the goal may lie on an edge that two triangles share
      return abs(dot(face, goal - a.xyz)) <= OWNER_SAME * length(face);
    }
    if (next < 0 || next == before) {
      return false;
    }
    before = current;
    current = next;
    if (current == last) {
      return true;
    }
  }
  return false;
}

// point, normal: of the hit. below: the texel's point on the low mesh, on the triangle `own`.
bool owner_has_hit(vec3 point, vec3 normal, vec3 below, int own)
{
  vec3 to_below = below - point;
  float best = dot(to_below, to_below) * (2.0 - OWNER_CLOSER);
  vec3 closest = below;
  int found = -1;
  if (owner_closer(own, point, normal, best, closest)) {
    found = own;
  }
  vec3 grid_point = (point - low_origin.xyz) * low_scale.xyz;
  vec3 unit = 1.0 / low_scale.xyz;
  uvec2 trail = uvec2(0u);
  int node = 0;
  while (node >= 0) {
    uvec4 x = floatBitsToUint(texel_at(low_nodes, texture_place(node * 3)));
    uvec4 y = floatBitsToUint(texel_at(low_nodes, texture_place(node * 3 + 1)));
    uvec4 z = floatBitsToUint(texel_at(low_nodes, texture_place(node * 3 + 2)));
    uint mask = tree_mask(lessThan(tree_distances(x, y, z, grid_point, unit), vec4(best)));
    int child = node * 4 + 1;
    if (mask != 0u && child < low_first_leaf) {
      node = tree_down(node, mask, trail);
    }
    else {
      node = tree_next(node, trail);
      while (mask != 0u) {
        int triangle = child - low_first_leaf + findLSB(mask);
        mask &= mask - 1u;
        if (owner_closer(triangle, point, normal, best, closest)) {
          found = triangle;
        }
      }
    }
  }
  return found >= 0 && (found == own || owner_walk_reaches(own, found, closest));
}
