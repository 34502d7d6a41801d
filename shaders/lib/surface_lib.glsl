// The place on the high surface that a ray hit, from the textures `surface_triangles` and `surface_points`.
#include "lib/hit_lib.glsl"
#include "lib/triangle_lib.glsl"

TriangleEdges surface_edges(uvec4 hit)
{
  ivec3 vertices = triangle_numbers(texel_at(surface_triangles, texture_place(hit_triangle(hit))));
  return TRIANGLE_EDGES(surface_points, vertices);
}

vec3 surface_point(uvec4 hit)
{
  return triangle_point(surface_edges(hit), hit_weights(hit));
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
  TriangleEdges edges = surface_edges(hit);
  float scale = triangle_scale(edges);
  vec3 across = cross(edges.edge1 * scale, edges.edge2 * scale);
  return length(across) > SURFACE_LEAST_HEIGHT * scale ? surface_unit(across, otherwise) : otherwise;
}
