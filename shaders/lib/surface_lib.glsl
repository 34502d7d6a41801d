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

// Triangles overlap a little (overlap_lib.glsl): where the hit is on an edge, as texels of even grids are, rays would meet the
// triangle across it. They start inside, at this share of the way to the middle of the triangle.
const float SURFACE_ON_EDGE = 1e-5;
const float SURFACE_INSIDE = 3e-3;

// Where rays from a hit start: the place itself, unless it is on an edge.
vec3 surface_start(uvec4 hit)
{
  vec2 weights = hit_weights(hit);
  bool is_on_edge = min(min(weights.x, weights.y), 1.0 - weights.x - weights.y) < SURFACE_ON_EDGE;
  return triangle_point(surface_edges(hit), is_on_edge ? mix(weights, vec2(1.0 / 3.0), SURFACE_INSIDE) : weights);
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
