// Adds rays from the point that each texel hit into the solid: the sum of the shares of `farthest` that they go before they
// leave it through a back.
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
  vec4 sum = numbers.w != 0 ? vec4(0.0) : imageLoad(sums, texel);
  uvec4 hit = texel_at(hits, texel);
  if (!hit_missed(hit)) {
    vec3 face = surface_face_normal(hit, vec3(0.0));
    vec3 normal = shading_normal(hit, vec3(0.0, 0.0, 1.0));
    vec3 origin = surface_point(hit);
    int own = hit_triangle(hit);
    vec2 shift = lattice_shift(texel, cell);
    for (int i = 0; i < numbers.y; i++) {
      vec2 point = lattice_point(numbers.x + i * numbers.z, steps.xyz, shift);
      vec3 direction = -lattice_direction(sqrt(1.0 - point.x), point.y, normal);
      // A ray that starts outwards leaves the solid at once.
      float end = dot(direction, face) < 0.0 ? farthest : -1.0;
      sum.x += reach_distance(origin, direction, end, own, REACH_BACKS, false) / farthest;
    }
  }
  imageStore(sums, texel, sum);
}
