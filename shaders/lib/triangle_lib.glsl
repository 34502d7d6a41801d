// Triangles by index. A texel of `triangles` has the numbers of a triangle's three vertices, whose places are in `points`, and in w
// where its normals are. cast.upload arranges both. Layers of UVs and other values have such texels of their own. What reads
// textures is a macro: functions cannot take images.
#include "lib/texture_lib.glsl"

// The first number. The bits of smaller ones would be denormals, which a driver may flush to zero.
const int TRIANGLE_FIRST = 1 << 23;

// The numbers of the three vertices, or of a layer's values at the corners.
ivec3 triangle_numbers(vec4 texel)
{
  return floatBitsToInt(texel.xyz) - TRIANGLE_FIRST;
}

// The fourth number of a texel.
int triangle_fourth(vec4 texel)
{
#ifdef CUTOUTS
  texel = cutout_without_mark(texel);
#endif
  return floatBitsToInt(texel.w) - TRIANGLE_FIRST;
}

// The places of the normals of the three corners: those of the vertices, or the triangle's own, one for all or three in a row.
ivec3 triangle_normals(vec4 texel)
{
  int own = triangle_fourth(texel) - 1;
  return own < 0 ? triangle_numbers(texel) : ivec3(own >> 1) + (own & 1) * ivec3(0, 1, 2);
}

struct TriangleEdges {
  vec3 corner;
  // From that corner to the other two.
  vec3 edge1, edge2;
};

TriangleEdges triangle_edges(vec4 a, vec4 b, vec4 c)
{
  TriangleEdges result;  // no constructor: Metal has none
  result.corner = a.xyz;
  result.edge1 = b.xyz - a.xyz;
  result.edge2 = c.xyz - a.xyz;
  return result;
}

// The edges of a triangle with these vertices.
#define TRIANGLE_EDGES(points, vertices) \
  triangle_edges(texel_at(points, texture_place(vertices.x)), \
                 texel_at(points, texture_place(vertices.y)), \
                 texel_at(points, texture_place(vertices.z)))

// The point with these barycentric coordinates.
vec3 triangle_point(TriangleEdges triangle, vec2 weights)
{
  return triangle.corner + triangle.edge1 * weights.x + triangle.edge2 * weights.y;
}

// What makes the longer edge 1 long: the square of the area of a small triangle is 0 in single precision.
float triangle_scale(TriangleEdges triangle)
{
  float largest = max(dot(triangle.edge1, triangle.edge1), dot(triangle.edge2, triangle.edge2));
  return largest > 0.0 ? inversesqrt(largest) : 0.0;
}

// The value at a point with these barycentric coordinates, from those of the corners.
vec4 triangle_mixed(vec4 a, vec4 b, vec4 c, vec2 weights)
{
  return a * (1.0 - weights.x - weights.y) + b * weights.x + c * weights.y;
}

// The same from the texels of `values` with three numbers.
#define TRIANGLE_MIXED(values, numbers, weights) \
  triangle_mixed(texel_at(values, texture_place(numbers.x)), \
                 texel_at(values, texture_place(numbers.y)), \
                 texel_at(values, texture_place(numbers.z)), \
                 weights)
