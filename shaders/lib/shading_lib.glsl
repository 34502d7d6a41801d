// The normal of the high surface that a ray hit, from the texture `surface_normals`.
#include "lib/surface_lib.glsl"

// The interpolated normal, with length 1; `otherwise` if it has no length.
vec3 shading_normal(uvec4 hit, vec3 otherwise)
{
  ivec3 places = triangle_normals(texel_at(surface_triangles, texture_place(hit_triangle(hit))));
  return surface_unit(TRIANGLE_MIXED(surface_normals, places, hit_weights(hit)).xyz, otherwise);
}
