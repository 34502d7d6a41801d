// The normal of the high surface that a ray hit, from the texture `surface_normals`.
#include "lib/surface_lib.glsl"
#include "lib/corner_lib.glsl"

// The interpolated normal, with length 1; `otherwise` if it has no length.
vec3 shading_normal(uvec4 hit, vec3 otherwise)
{
  int first = hit_triangle(hit) * 3;
  vec2 weights = hit_weights(hit);
  return surface_unit(texel_at(surface_normals, corner_normal(texel_at(surface_corners, texture_place(first)))).xyz * (1.0 - weights.x - weights.y) +
                          texel_at(surface_normals, corner_normal(texel_at(surface_corners, texture_place(first + 1)))).xyz * weights.x +
                          texel_at(surface_normals, corner_normal(texel_at(surface_corners, texture_place(first + 2)))).xyz * weights.y,
                      otherwise);
}
