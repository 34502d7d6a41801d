// Adds rays from the point that each texel hit into the solid: the sum of the shares of `farthest` that they go before they
// leave it through a back.
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
    vec3 normal = shading_normal(hit, vec3(0.0, 0.0, 1.0));
    vec3 face = surface_face_normal(hit, normal);
    vec3 origin = surface_point(hit);
    int own = hit_triangle(hit);
    vec2 shift = lattice_shift(texel + ivec2(0, numbers.w >> 1), cell);
    int turns = TURNS_MOST;
    int i = 0;
    ReachWalk walk;
    walk.node = -1;
    sums_go_on(walk.node, walk.trail, walk.to, i, sum);
    for (; i < numbers.y; i += REACH_RAYS) {
      vec4 u;
      vec4 v;
      vec4 x;
      vec4 y;
      vec4 z;
      lattice_points(numbers.x + i * numbers.z, numbers.z, steps.xyz, shift, u, v);
      vec4 exists = lattice_exists(numbers.y - i);
      lattice_directions(-sqrt(1.0 - u), v, normal, x, y, z);
      // Rays that start outwards leave the solid at once.
      bvec4 is_inside = greaterThan(vec4(0.0), exists * (x * face.x + y * face.y + z * face.z));
      vec4 end = mix(vec4(-1.0), vec4(farthest), is_inside);
      vec4 reached = reach_distances(origin, x, y, z, end, own, REACH_BACKS, false, walk, turns);
      if (walk.node >= 0) {
        break;
      }
      sum.x += dot(reached, vec4(1.0)) / farthest;
    }
    if (walk.node >= 0) {
      sums_leave(texel, walk.node, walk.trail, walk.to, i, sum);
      return;
    }
  }
  imageStore(sums, texel, sum);
}
