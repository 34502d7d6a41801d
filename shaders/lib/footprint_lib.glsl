// Where a hit lies in a page, and how much of the page one texel covers there. Two texels of `uvs` have each triangle: three
// pairs of UVs, and in the third component of the second the number of its material. row_u and row_v map UVs to the page.
#include "lib/texture_lib.glsl"
#include "lib/hit_lib.glsl"

// A step to a neighbor that is longer than this, in pixels, may lead across a seam.
const float FOOTPRINT_JUMP = 1.0;
// A step that is this many times as long as the one along the triangle's own plane leads across a seam.
const float FOOTPRINT_UNEVEN = 2.0;

vec2 footprint_uv(uvec4 hit, vec4 first, vec4 last)
{
  vec2 weights = hit_weights(hit);
  return first.xy * (1.0 - weights.x - weights.y) + first.zw * weights.x + last.xy * weights.y;
}

// UVs as coordinates of the page, 0 to 1 across it.
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

// From steps in UVs to pixels of the page.
mat2 footprint_to_pixels(ivec2 size)
{
  return mat2(row_u.x * float(size.x), row_v.x * float(size.y), row_u.y * float(size.x), row_v.y * float(size.y));
}

bool footprint_has(ivec2 place)
{
  return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, texel_size(hits)));
}

// The step in UVs along the plane of the hit's triangle, for the shorter one of the steps in space to both neighbors.
// z is 1, or -1 if there is no neighbor.
vec3 footprint_in_plane(ivec2 texel, ivec2 axis, uvec4 hit, vec4 first, vec4 last)
{
  int corner = hit_triangle(hit) * 3;
  vec3 origin = texel_at(corners, texture_place(corner)).xyz;
  vec3 edge1 = texel_at(corners, texture_place(corner + 1)).xyz - origin;
  vec3 edge2 = texel_at(corners, texture_place(corner + 2)).xyz - origin;
  vec2 weights = hit_weights(hit);
  vec3 offset = vec3(0.0);
  float least = 1e30;
  for (int side = -1; side <= 1; side += 2) {
    ivec2 place = texel + axis * side;
    if (footprint_has(place)) {
      uvec4 other = texel_at(hits, place);
      int its_corner = max(hit_triangle(other), 0) * 3;
      vec2 its_weights = hit_weights(other);
      vec3 its_origin = texel_at(corners, texture_place(its_corner)).xyz;
      vec3 its_edge1 = texel_at(corners, texture_place(its_corner + 1)).xyz - its_origin;
      vec3 its_edge2 = texel_at(corners, texture_place(its_corner + 2)).xyz - its_origin;
      vec3 to_other = its_origin - origin + its_edge1 * its_weights.x + its_edge2 * its_weights.y - edge1 * weights.x -
                      edge2 * weights.y;
      if (!hit_missed(other) && dot(to_other, to_other) < least) {
        least = dot(to_other, to_other);
        offset = to_other * float(side);
      }
    }
  }
  vec3 normal = cross(edge1, edge2);
  float square = dot(normal, normal);
  if (!(square > 0.0) || least == 1e30) {
    return vec3(0.0, 0.0, -1.0);
  }
  vec2 along = (first.zw - first.xy) * (dot(cross(offset, edge2), normal) / square) +
               (last.xy - first.xy) * (dot(cross(edge1, offset), normal) / square);
  return vec3(along, 1.0);
}

// The step in pixels from a texel to the next one along `axis`; z is negative if no neighbor tells it. Across a seam, UVs jump:
// then the neighbor on the other side counts, or the plane of the triangle.
vec3 footprint_step(ivec2 texel, ivec2 axis, uvec4 hit, vec2 uv, vec4 first, vec4 last, mat2 to_pixels)
{
  vec3 shorter = vec3(0.0, 0.0, -1.0);
  float least = 1e30;
  for (int side = -1; side <= 1; side += 2) {
    ivec2 place = texel + axis * side;
    if (footprint_has(place)) {
      uvec4 other = texel_at(hits, place);
      int triangle = max(hit_triangle(other), 0);
      vec4 its_first = texel_at(uvs, texture_place(triangle * 2));
      vec4 its_last = texel_at(uvs, texture_place(triangle * 2 + 1));
      vec2 apart = to_pixels * (footprint_uv(other, its_first, its_last) - uv) * float(side);
      if (!hit_missed(other) && int(its_last.z) == int(last.z)) {
        // On the same triangle there is no seam.
        float size = triangle == hit_triangle(hit) ? -1.0 : length(apart);
        shorter = size < least ? vec3(apart, 1.0) : shorter;
        least = min(size, least);
      }
    }
  }
  int is_unsure = int(least > FOOTPRINT_JUMP);
  for (int i = 0; i < is_unsure; i++) {
    vec3 in_plane = footprint_in_plane(texel, axis, hit, first, last);
    in_plane.xy = to_pixels * in_plane.xy;
    shorter = in_plane.z > 0.0 && least > length(in_plane.xy) * FOOTPRINT_UNEVEN ? in_plane : shorter;
  }
  return shorter;
}

// The steps in pixels to the next texel to the right and to the one above, in columns.
mat2 footprint_of(ivec2 texel, uvec4 hit, vec2 uv, vec4 first, vec4 last, mat2 to_pixels)
{
  vec3 right = vec3(0.0);
  vec3 above = vec3(0.0);
  for (int i = 0; i < 2; i++) {
    vec3 found = footprint_step(texel, ivec2(1 - i, i), hit, uv, first, last, to_pixels);
    right = i == 0 ? found : right;
    above = found;
  }
  // Without neighbors along one axis, the texel counts as square.
  if (right.z < 0.0) {
    right = vec3(above.y, -above.x, 0.0);
  }
  if (above.z < 0.0) {
    above = vec3(-right.y, right.x, 0.0);
  }
  return mat2(right.xy, above.xy);
}
