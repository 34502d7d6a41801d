// Traces one ray per texel from outside the low mesh inwards, and chooses a hit on the high meshes. mesh/spatial/bvh.py
// builds the trees.
#include "lib/active_lib.glsl"
#include "lib/overlap_lib.glsl"
#include "lib/texture_lib.glsl"
#include "lib/tree_lib.glsl"
#include "lib/closest_lib.glsl"
#include "lib/owner_lib.glsl"
#include "lib/hit_lib.glsl"

// As in core.declarations.choices.Hit, in its order.
const int CAST_OWN = 0;
const int CAST_NEAREST = 2;

// The most hits of a ray that are asked for their owner, so that no ray takes long.
const int CAST_CANDIDATES = 16;
// The least distance, in local space, between a hit and the next one.
const float CAST_BEYOND = 1e-8;

void main()
{
  ivec2 texel = active_texel(first_row, texel_size(positions).x);
  if (any(greaterThanEqual(texel, texel_size(positions)))) {
    return;
  }
  vec4 below = texel_at(positions, texel);
  uvec4 chosen = uvec4(0u);
  if (below.a > 0.0) {
    vec4 away = texel_at(directions, texel);
    float start = away.w;  // how far outside the low surface
    vec3 direction = -away.xyz;
    vec3 origin = below.xyz + away.xyz * start;
    float end = min(max_t, start + inside);

    // In grid steps, boxes have integer coordinates. A zero component would give 0 * infinity for a ray inside a slab.
    vec3 grid_start = (origin - grid_origin.xyz) * grid_scale.xyz;
    vec3 grid_direction = direction * grid_scale.xyz;
    grid_direction = mix(grid_direction, vec3(1e-12), lessThan(abs(grid_direction), vec3(1e-12)));
    vec3 inverse = 1.0 / grid_direction;
    bvec3 forward = greaterThan(inverse, vec3(0.0));

    bool facing = facing_only != 0 || rule == CAST_OWN;
    bool is_last = rule != CAST_OWN;
    float first = 0.0;
    float wanted = rule == CAST_NEAREST ? start : 0.0;  // the hit nearest to this place on the ray is searched for
    uvec4 fallback = uvec4(0u);
    float fallback_distance = 1e30;
    for (int search = 0; search <= CAST_CANDIDATES; search++) {
      uvec4 hit = uvec4(0u);
      float best = 1e30;
      float from = first;
      float to = end;
      uvec2 trail = uvec2(0u);
      int node = 0;
      while (node >= 0) {
        uint triangles = 0u;
        int leaf = 0;
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
      if (is_last) {
        chosen = hit;
        if (rule == CAST_OWN && hit.x != 0u) {
          chosen.x |= HIT_FROM_BEHIND;
        }
        break;
      }
      if (hit.x == 0u) {  // no more hits that face the ray
        if (fallback.x != 0u || facing_only != 0) {
          chosen = fallback;
          break;
        }
        is_last = true;
        facing = false;
        first = 0.0;
        wanted = start;
        continue;
      }
      float t = uintBitsToFloat(hit.w);
      int corner = int(hit.x - 1u) * 3;
      vec2 weights = vec2(uintBitsToFloat(hit.y), uintBitsToFloat(hit.z));
      vec3 normal = texel_at(normals, texture_place(corner)).xyz * (1.0 - weights.x - weights.y) +
                    texel_at(normals, texture_place(corner + 1)).xyz * weights.x +
                    texel_at(normals, texture_place(corner + 2)).xyz * weights.y;
      if (owner_has_hit(origin + direction * t, normal, below.xyz, int(below.a) - 1, start - t > near)) {
        chosen = hit;
        break;
      }
      if (abs(t - start) < fallback_distance) {
        fallback_distance = abs(t - start);
        fallback = uvec4(hit.x | HIT_NOT_OWNED, hit.yzw);
      }
      chosen = fallback;
      first = t * (1.0 + OVERLAP_ROUNDING) + CAST_BEYOND;
    }
    chosen.w = chosen.x == 0u ? 0u : floatBitsToUint(start - uintBitsToFloat(chosen.w));
  }
  imageStore(hits, texel, chosen);
}
