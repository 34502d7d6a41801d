// The place on the high surface that a ray hit, from the texture `surface_corners`.
#include "lib/texture_lib.glsl"
#include "lib/hit_lib.glsl"

vec3 surface_point(uvec4 hit)
{
  int first = hit_triangle(hit) * 3;
  vec2 weights = hit_weights(hit);
  vec3 corner = texel_at(surface_corners, texture_place(first)).xyz;
  vec3 edge1 = texel_at(surface_corners, texture_place(first + 1)).xyz - corner;
  vec3 edge2 = texel_at(surface_corners, texture_place(first + 2)).xyz - corner;
  return corner + edge1 * weights.x + edge2 * weights.y;
}

// `vector` with length 1, or `otherwise` if it has no length.
vec3 surface_unit(vec3 vector, vec3 otherwise)
{
  float length_squared = dot(vector, vector);
  return length_squared > 0.0 ? vector / sqrt(length_squared) : otherwise;
}

// The least height of a triangle whose edges have a direction across, in local space, whose radius is about 1. Below, rounding
// of its corners decides.
const float SURFACE_LEAST_HEIGHT = 2.5e-7;

// The normal of the triangle itself, by its winding; `otherwise` for a triangle without area, such as a half of a quad at the
// pole of a ball.
vec3 surface_face_normal(uvec4 hit, vec3 otherwise)
{
  int first = hit_triangle(hit) * 3;
  vec3 corner = texel_at(surface_corners, texture_place(first)).xyz;
  vec3 edge1 = texel_at(surface_corners, texture_place(first + 1)).xyz - corner;
  vec3 edge2 = texel_at(surface_corners, texture_place(first + 2)).xyz - corner;
  // Scaled first: the square of the area of a small triangle is 0 in single precision.
  float largest = max(dot(edge1, edge1), dot(edge2, edge2));
  float scale = largest > 0.0 ? inversesqrt(largest) : 0.0;
  vec3 across = cross(edge1 * scale, edge2 * scale);
  return length(across) > SURFACE_LEAST_HEIGHT * scale ? surface_unit(across, otherwise) : otherwise;
}
