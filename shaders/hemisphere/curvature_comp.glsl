// Adds rays from the point that each texel hit, in pairs: one into the solid, and one in the opposite direction. They measure
// how much of a ball around the point is inside. x has the sum of what the inner half lacks, y of what the outer half holds.
#include "lib/block_lib.glsl"
#include "lib/lattice_lib.glsl"
#include "lib/shading_lib.glsl"
#include "lib/reach_lib.glsl"
#include "lib/sums_lib.glsl"

void main()
{
  float farthest = grid_scale.w;
  ivec2 texel = block_texel(carried_row());
  if (any(greaterThanEqual(texel, textureSize(hits, 0)))) {
    return;
  }
  vec4 sum;
  if (!sums_begin(texel, sum)) {
    return;
  }
  uvec4 hit = texelFetch(hits, texel, 0);
  if (!hit_missed(hit)) {
    vec3 face = surface_face_normal(hit, shading_normal(hit, vec3(0.0, 0.0, 1.0)));
    vec3 origin = surface_point(hit);
    int own = hit_triangle(hit);
    vec2 shift = lattice_shift(texel + ivec2(0, numbers.w >> 1), cell);
    int turns = TURNS_MOST;
    int next = 0;  // twice the first of four rays, or 1 more for those outwards
    ReachWalk walk;
    walk.node = -1;
    sums_go_on(walk.node, walk.trail, walk.to, next, sum);
    for (int i = next >> 1; i < numbers.y; i += REACH_RAYS) {
      vec4 u;
      vec4 v;
      vec4 x;
      vec4 y;
      vec4 z;
      lattice_points(numbers.x + i * numbers.z, numbers.z, steps.xyz, shift, u, v);
      vec4 exists = lattice_exists(numbers.y - i);
      // Many rays near the tangent plane, where a smooth surface leaves it. The weight makes up for it: the derivative.
      lattice_directions(u * u, v, face, x, y, z);
      vec4 weight = 2.0 * u * exists;
      for (int side = next & 1; side < 2; side++) {
        float sign_of_side = side == 0 ? -1.0 : 1.0;
        vec4 reached = reach_distances(origin, x * sign_of_side, y * sign_of_side, z * sign_of_side, vec4(farthest), own,
                                       side == 0 ? REACH_BACKS : REACH_FRONTS, false, walk, turns);
        if (walk.node >= 0) {
          next = 2 * i + side;
          break;
        }
        vec4 share = reached / farthest;
        float beyond = dot(weight, 1.0 - share * share * share);
        sum.xy += side == 0 ? vec2(beyond, 0.0) : vec2(0.0, beyond);
      }
      if (walk.node >= 0) {
        break;
      }
      next = 0;
    }
    if (walk.node >= 0) {
      sums_leave(texel, walk.node, walk.trail, walk.to, next, sum);
      return;
    }
  }
  imageStore(sums, texel, sum);
}
