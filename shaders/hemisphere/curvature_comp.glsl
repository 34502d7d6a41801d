// Adds rays from the point that each texel hit, in pairs: one into the solid, and one in the opposite direction. They measure
// how much of a ball around the point is inside. x has the sum of what the inner half lacks, y of what the outer half holds.
#include "lib/block_lib.glsl"
#include "lib/lattice_lib.glsl"
#include "lib/shading_lib.glsl"
#include "lib/reach_lib.glsl"

void main()
{
  float farthest = grid_scale.w;
  ivec2 texel = block_texel(first_row);
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  vec4 sum = (numbers.w & 1) != 0 ? vec4(0.0) : imageLoad(sums, texel);
  uvec4 hit = texel_at(hits, texel);
  if (!hit_missed(hit)) {
    vec3 face = surface_face_normal(hit, shading_normal(hit, vec3(0.0, 0.0, 1.0)));
    vec3 origin = surface_point(hit);
    int own = hit_triangle(hit);
    vec2 shift = lattice_shift(texel + ivec2(0, numbers.w >> 1), cell);
    for (int i = 0; i < numbers.y; i += REACH_RAYS) {
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
      vec4 end = vec4(farthest);
      vec4 inner = reach_distances(origin, -x, -y, -z, end, own, REACH_BACKS, false) / farthest;
      vec4 outer = reach_distances(origin, x, y, z, end, own, REACH_FRONTS, false) / farthest;
      sum.xy += vec2(dot(weight, 1.0 - inner * inner * inner), dot(weight, 1.0 - outer * outer * outer));
    }
  }
  imageStore(sums, texel, sum);
}
