// Reads the map across a seam between UV islands. The program has the samplers `values` and `similarities`, and the constants
// `kind` and `first_row`: the row of the map that is row 0 of `values`.
#include "lib/texture_lib.glsl"

const int SEAM_LABEL = 1;    // numbers that must not be averaged
const int SEAM_NORMAL = 2;
const int SEAM_TANGENT = 3;  // normals in tangent space
const int SEAM_VECTOR = 4;   // along tangent, normal and bitangent, of any length
const float SEAM_FARTHEST = 256.0;

// The value of a texel of the map, 0 outside of it.
vec4 seam_texel(ivec2 place)
{
  place.y -= first_row;
  ivec2 size = textureSize(values, 0);
  bool is_outside = any(lessThan(place, ivec2(0))) || any(greaterThanEqual(place, size));
  return is_outside ? vec4(0.0) : texelFetch(values, place, 0);
}

vec2 seam_product(vec2 a, vec2 b)
{
  return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

// The last texel of the margin on the way from a texel to the nearest written one.
ivec2 seam_beside(ivec2 texel, ivec2 way)
{
  float steps = float(max(abs(way.x), abs(way.y)));
  return texel + way - ivec2(floor(vec2(way) / steps + 0.5));
}

// The rotation and scale of a border, then -1 if it mirrors and 1 if not, then 0 where the surface ends and 1 elsewhere.
vec4 seam_turn(int border)
{
  return texelFetch(similarities, texture_place(2 * border + 1), 0);
}

// Where the surface continues across a border, for the center of a texel, in texels of the map.
vec2 seam_place(int border, ivec2 texel)
{
  vec4 ends = texelFetch(similarities, texture_place(2 * border), 0);
  vec4 turn = seam_turn(border);
  return ends.zw + seam_product((vec2(texel) + 0.5 - ends.xy) * vec2(1.0, turn.z), turn.xy);
}

// The value across a border for a texel of the margin, with alpha 0 if the nearest texel is to stay. beside: of seam_beside.
vec4 seam_value(int border, ivec2 texel, ivec2 beside)
{
  vec2 start = seam_place(border, beside);
  vec2 place = seam_place(border, texel);
  float far = distance(start, place);
  bool is_close = far <= SEAM_FARTHEST;
  if (!is_close) {
    return vec4(0.0);
  }
  // Stop where the island across ends: another one may begin behind it.
  for (float at = 1.0; at < far; at += 1.0) {
    if (seam_texel(ivec2(floor(mix(start, place, at / far)))).a == 0.0) {
      return vec4(0.0);
    }
  }
  vec2 corner = kind == SEAM_LABEL ? floor(place) : place - 0.5;
  vec2 part = corner - floor(corner);
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 4; i++) {
    ivec2 next = ivec2(i & 1, i >> 1);
    vec4 value = seam_texel(ivec2(floor(corner)) + next);
    vec2 weight = mix(1.0 - part, part, vec2(next));
    if (value.a > 0.0) {
      sum += weight.x * weight.y * vec4(value.xyz, 1.0);
    }
  }
  if (sum.a <= 0.0) {
    return vec4(0.0);
  }
  vec3 value = sum.xyz / sum.a;
  if (kind == SEAM_TANGENT || kind == SEAM_VECTOR) {
    // The similarity rotated the directions along the surface: rotate them back.
    vec4 turn = seam_turn(border);
    vec2 along = kind == SEAM_VECTOR ? value.xz : value.xy;
    along = seam_product(along * vec2(1.0, turn.z), normalize(turn.xy) * vec2(1.0, -turn.z));
    value = kind == SEAM_VECTOR ? vec3(along.x, value.y, along.y) : vec3(along, value.z);
  }
  if (kind == SEAM_NORMAL || kind == SEAM_TANGENT) {
    float length_squared = dot(value, value);
    if (length_squared <= 0.0) {
      return vec4(0.0);
    }
    value /= sqrt(length_squared);
  }
  return vec4(value, 1.0);
}
