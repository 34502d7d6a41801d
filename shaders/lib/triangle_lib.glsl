// The triangles of the high meshes: three texels each in a texture `corners`, with their positions and the numbers of their
// normals. cast.upload arranges it. Macros, since functions cannot take images.
#include "lib/texture_lib.glsl"

// The first number. The bits of smaller ones would be denormals, which a driver may flush to zero.
const int TRIANGLE_FIRST = 1 << 23;

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

#define TRIANGLE_EDGES(corners, triangle) \
  triangle_edges(texel_at(corners, texture_place((triangle)*3)), \
                 texel_at(corners, texture_place((triangle)*3 + 1)), \
                 texel_at(corners, texture_place((triangle)*3 + 2)))

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

// The same from three texels of a triangle in the texture `values`.
#define TRIANGLE_MIXED(values, triangle, weights) \
  triangle_mixed(texel_at(values, texture_place((triangle)*3)), \
                 texel_at(values, texture_place((triangle)*3 + 1)), \
                 texel_at(values, texture_place((triangle)*3 + 2)), \
                 weights)

// The place in `normals` of a corner's normal. texel: of the corner.
ivec2 triangle_normal_place(vec4 texel)
{
  return texture_place(floatBitsToInt(texel.w) - TRIANGLE_FIRST);
}

// The interpolated normal, of any length.
#define TRIANGLE_NORMAL(corners, normals, triangle, weights) \
  triangle_mixed(texel_at(normals, triangle_normal_place(texel_at(corners, texture_place((triangle)*3)))), \
                 texel_at(normals, triangle_normal_place(texel_at(corners, texture_place((triangle)*3 + 1)))), \
                 texel_at(normals, triangle_normal_place(texel_at(corners, texture_place((triangle)*3 + 2)))), \
                 weights) \
      .xyz
