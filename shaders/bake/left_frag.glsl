// Writes the points of the low mesh as rays take them, without those of texels whose hit by Flatten belongs to them: alpha 0 there.
#include "lib/owner_lib.glsl"
#include "lib/hit_lib.glsl"
#include "lib/triangle_lib.glsl"

// Texels. A high point that lies farther from the ray of its texel, along the surface, is at another place.
const float LEFT_MOST = 2.0;
// Texels. A high point that lies closer to it is at its own place.
const float LEFT_SAME = 0.02;
// How far beyond the place that belongs to the texel Flatten must draw the same: in texels, and as a share of the way.
const float LEFT_BEYOND = 1.5, LEFT_FARTHER = 0.5;
// The cosine of 5 degrees. Normals on the way may differ by less: then a hit at one end of it shows about what one at the other
// end shows, and no border is seen between texels of Flatten and of rays.
const float LEFT_ALIKE = 0.99619;

// The way on the low surface from a texel to the next one along `axis`: the shorter one of both sides, or 0 if there is none.
vec3 left_way(ivec2 texel, ivec2 axis, vec3 here)
{
  vec3 found = vec3(0.0);
  float best = 1e30;
  for (int side = -1; side <= 1; side += 2) {
    ivec2 place = texel + axis * side;
    if (all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, texel_size(positions)))) {
      vec4 there = texel_at(positions, place);
      vec3 way = (there.xyz - here) * float(side);
      float squared = dot(way, way);
      if (there.a > 0.0 && squared < best) {
        best = squared;
        found = way;
      }
    }
  }
  return found;
}

// Whether Flatten draws what belongs to a texel on one close to it, with normals alike on the way. beside: the vector along the
// surface from the texel's own place to its high point.
bool left_is_alike(ivec2 texel, vec3 here, vec3 beside, vec3 normal)
{
  vec3 u = left_way(texel, ivec2(1, 0), here), v = left_way(texel, ivec2(0, 1), here);
  float uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), us = dot(u, beside), vs = dot(v, beside);
  float area = uu * vv - uv * uv;
  if (area <= 1e-6 * uu * vv) {
    return false;
  }
  vec2 way = -vec2(vv * us - uv * vs, uu * vs - uv * us) / area;  // in texels
  float far = length(way);
  if (far >= LEFT_MOST) {
    return false;
  }
  if (far < LEFT_SAME) {
    return true;
  }
  way /= far;
  far += far * LEFT_FARTHER + LEFT_BEYOND;
  for (float at = 1.0; at < far + 1.0; at += 1.0) {
    ivec2 place = ivec2(round(vec2(texel) + way * min(at, far)));
    place = clamp(place, ivec2(0), texel_size(positions) - 1);
    vec4 there = texel_at(flat_normals, place);
    if (there.a <= 0.0 || dot(there.xyz, normal) <= LEFT_ALIKE) {
      return false;
    }
  }
  return true;
}

bool left_is_own(ivec2 texel, vec4 below)
{
  uvec4 hit = texel_at(flat_hits, texel);
  vec4 normal = texel_at(flat_normals, texel);
  vec4 away = texel_at(directions, texel);
  if (hit_missed(hit) || normal.a <= 0.0 || dot(normal.xyz, away.xyz) <= 0.0) {
    return false;
  }
  ivec3 vertices = triangle_numbers(texel_at(triangles, texture_place(hit_triangle(hit))));
  vec3 point = TRIANGLE_MIXED(points, vertices, hit_weights(hit)).xyz;
  vec3 offset = point - below.xyz;
  float height = dot(offset, away.xyz);
  vec3 beside = offset - away.xyz * height;
  // A search that takes too many turns says no: then a ray is cast.
  OwnerWalk walk;
  walk.node = -1;
  int turns = TURNS_MOST;
  return left_is_alike(texel, below.xyz, beside, normal.xyz) &&
         owner_has_hit(point, normal.xyz, below.xyz, int(below.a) - 1, height > near, walk, turns);
}

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  vec4 below = texel_at(positions, texel);
  left_out = vec4(below.xyz, below.a > 0.0 && left_is_own(texel, below) ? 0.0 : below.a);
}
