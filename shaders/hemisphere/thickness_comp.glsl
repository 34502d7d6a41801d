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
  vec4 sum = (numbers.w & 1) != 0 ? vec4(0.0) : imageLoad(sums, texel);
  uvec4 hit = texel_at(hits, texel);
  if (!hit_missed(hit)) {
    vec3 normal = shading_normal(hit, vec3(0.0, 0.0, 1.0));
    vec3 face = surface_face_normal(hit, normal);
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
      lattice_directions(-sqrt(1.0 - u), v, normal, x, y, z);
      // Rays that start outwards leave the solid at once.
      bvec4 is_inside = greaterThan(vec4(0.0), exists * (x * face.x + y * face.y + z * face.z));
      vec4 end = mix(vec4(-1.0), vec4(farthest), is_inside);
      sum.x += dot(reach_distances(origin, x, y, z, end, own, REACH_BACKS, false), vec4(1.0)) / farthest;
    }
  }
  imageStore(sums, texel, sum);
}
