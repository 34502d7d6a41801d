// Where a hit lies in an image, and how much of the image one texel covers there. `uv_triangles` has the numbers of each triangle's
// UVs in `uvs`, and the number of its material. row_u and row_v map UVs to the image.
#include "lib/hit_lib.glsl"
#include "lib/triangle_lib.glsl"

// A step to a neighbor that is longer than this, in pixels, may lead across a seam.
const float FOOTPRINT_JUMP = 1.0;
// A step that is this many times as long as the one along the triangle's own plane leads across a seam.
const float FOOTPRINT_UNEVEN = 2.0;

struct FootprintUvs {
  vec2 a, b, c;
  int material;
};

FootprintUvs footprint_uvs(int triangle)
{
  vec4 texel = texel_at(uv_triangles, texture_place(triangle));
  ivec3 numbers = triangle_numbers(texel);
  FootprintUvs result;  // no constructor: Metal has none
  result.a = texel_at(uvs, texture_place(numbers.x)).xy;
  result.b = texel_at(uvs, texture_place(numbers.y)).xy;
  result.c = texel_at(uvs, texture_place(numbers.z)).xy;
  result.material = triangle_fourth(texel);
  return result;
}

vec2 footprint_uv(uvec4 hit, FootprintUvs corners)
{
  vec2 weights = hit_weights(hit);
  return corners.a * (1.0 - weights.x - weights.y) + corners.b * weights.x + corners.c * weights.y;
}

// UVs as coordinates of the image, 0 to 1 across it.
vec2 footprint_mapped(vec2 uv)
{
  return vec2(dot(row_u.xy, uv) + row_u.z, dot(row_v.xy, uv) + row_v.z);
}

// Coordinates within the UDIM tile of this number; 0 is no tile.
vec2 footprint_in_tile(vec2 place, int tile_number)
{
  int number = max(tile_number - 1001, 0);
  return place - vec2(number % 10, number / 10);
}

bool footprint_is_outside(vec2 place)
{
  return any(lessThan(place, vec2(0.0))) || any(greaterThanEqual(place, vec2(1.0)));
}

// From steps in UVs to pixels of the image.
mat2 footprint_to_pixels(ivec2 size)
{
  return mat2(vec2(row_u.x, row_v.x) * vec2(size), vec2(row_u.y, row_v.y) * vec2(size));
}

bool footprint_has(ivec2 place)
{
  return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, texel_size(hits)));
}

// The step in UVs from a texel to the next one along `axis`, by the plane of the hit's own triangle and the shorter one of the
// steps in space to both neighbors, forth or back. z is 1, or -1 if there is no neighbor.
vec3 footprint_in_plane(ivec2 texel, ivec2 axis, FootprintUvs corners)
{
  vec3 point = vec3(0.0);
  TriangleEdges edges = triangle_edges(vec4(0.0), vec4(0.0), vec4(0.0));
  vec3 way = vec3(0.0);
  float least = 1e30;
  // The hit itself, then its neighbors.
  for (int i = 0; i < 3; i++) {
    int side = i == 2 ? -1 : i;
    ivec2 place = texel + axis * side;
    uvec4 other = texel_at(hits, clamp(place, ivec2(0), texel_size(hits) - 1));
    ivec3 vertices = triangle_numbers(texel_at(triangles, texture_place(max(hit_triangle(other), 0))));
    TriangleEdges its_edges = TRIANGLE_EDGES(points, vertices);
    vec3 its_point = triangle_point(its_edges, hit_weights(other));
    vec3 apart = its_point - point;
    if (side == 0) {
      point = its_point;
      edges = its_edges;
    }
    else if (footprint_has(place) && !hit_missed(other) && dot(apart, apart) < least) {
      least = dot(apart, apart);
      way = apart;
    }
  }
  float unit = triangle_scale(edges);
  vec3 edge1 = edges.edge1 * unit, edge2 = edges.edge2 * unit;
  way *= unit;
  vec3 normal = cross(edge1, edge2);
  float square = dot(normal, normal);
  if (square <= 0.0 || least == 1e30) {
    return vec3(0.0, 0.0, -1.0);
  }
  vec2 along = (corners.b - corners.a) * (dot(cross(way, edge2), normal) / square) +
               (corners.c - corners.a) * (dot(cross(edge1, way), normal) / square);
  return vec3(along, 1.0);
}

// The steps in pixels to the next texel to the right and to the one above, in columns. Across a seam, UVs jump, and to another
// material, they tell nothing: then the plane of the hit's triangle does.
mat2 footprint_of(ivec2 texel, uvec4 hit, vec2 uv, FootprintUvs corners, mat2 to_pixels)
{
  // z is the length; 0 on the same triangle, where there is no seam, and 1e30 without a neighbor.
  vec3 right = vec3(0.0, 0.0, 1e30);
  vec3 above = vec3(0.0, 0.0, 1e30);
  for (int axis = 0; axis < 2; axis++) {
    ivec2 place = texel + ivec2(1 - axis, axis);
    uvec4 other = texel_at(hits, min(place, texel_size(hits) - 1));
    int triangle = max(hit_triangle(other), 0);
    FootprintUvs its_corners = footprint_uvs(triangle);
    vec2 apart = to_pixels * (footprint_uv(other, its_corners) - uv);
    bool counts = footprint_has(place) && !hit_missed(other) && its_corners.material == corners.material;
    float size = triangle == hit_triangle(hit) ? 0.0 : length(apart);
    vec3 found = counts ? vec3(apart, size) : vec3(0.0, 0.0, 1e30);
    right = axis == 0 ? found : right;
    above = found;
  }
  for (int axis = 0; axis < 2; axis++) {
    // Steps that are short do not show, even if they are wrong.
    if ((axis == 0 ? right.z : above.z) > FOOTPRINT_JUMP) {
      vec3 in_plane = footprint_in_plane(texel, ivec2(1 - axis, axis), corners);
      vec2 apart = to_pixels * in_plane.xy;
      float most = in_plane.z > 0.0 ? length(apart) * FOOTPRINT_UNEVEN : 1e30;
      right = axis == 0 && right.z > most ? vec3(apart, 0.0) : right;
      above = axis == 1 && above.z > most ? vec3(apart, 0.0) : above;
    }
  }
  // Without neighbors along one axis, the texel counts as square.
  if (right.z == 1e30) {
    right.xy = vec2(above.y, -above.x);
  }
  if (above.z == 1e30) {
    above.xy = vec2(-right.y, right.x);
  }
  return mat2(right.xy, above.xy);
}
