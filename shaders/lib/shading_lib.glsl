// The normal of the high surface that a ray hit, from the texture `surface_normals`.
#include "lib/surface_lib.glsl"

// The interpolated normal, with length 1; `otherwise` if it has no length.
vec3 shading_normal(uvec4 hit, vec3 otherwise)
{
  return surface_unit(TRIANGLE_NORMAL(surface_corners, surface_normals, hit_triangle(hit), hit_weights(hit)), otherwise);
}
