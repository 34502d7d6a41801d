// Fills the margin beside a seam with values from across it. Discards other texels, which keep their values.
#include "lib/nearest_lib.glsl"
#include "lib/state_lib.glsl"
#include "lib/texture_lib.glsl"

const int ACROSS_LABEL = 1;    // numbers that must not be averaged
const int ACROSS_NORMAL = 2;
const int ACROSS_TANGENT = 3;  // normals in tangent space
const float ACROSS_FARTHEST = 256.0;

vec4 across_texel(ivec2 place)
{
  ivec2 size = textureSize(values, 0);
  bool is_outside = any(lessThan(place, ivec2(0))) || any(greaterThanEqual(place, size));
  return is_outside ? vec4(0.0) : texelFetch(values, place, 0);
}

vec2 across_product(vec2 a, vec2 b)
{
  return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy) + ivec2(0, halo);
  if (texelFetch(values, texel, 0).a != 0.0) {
    discard;
  }
  ivec2 way = nearest_way(texel);
  int steps = max(abs(way.x), abs(way.y));
  if (steps > reach) {
    discard;
  }
  ivec2 last_step = ivec2(floor(vec2(way) / float(steps) + 0.5));
  ivec2 beside = texel + way - last_step;
  int border = int(texelFetch(borders, beside, 0).x + 0.5) - 1;
  vec4 ends = texelFetch(similarities, texture_place(2 * max(border, 0)), 0);
  vec4 turn = texelFetch(similarities, texture_place(2 * max(border, 0) + 1), 0);
  if (border < 0 || turn.w == 0.0) {
    discard;
  }
  if (is_deferred != 0) {
    map_out = vec4(float(border), vec2(way), 0.0);
    state_out = STATE_DEFERRED;
    return;
  }

  vec2 mirror = vec2(1.0, turn.z);
  vec2 start = ends.zw + across_product((vec2(beside) + 0.5 - ends.xy) * mirror, turn.xy);
  vec2 place = ends.zw + across_product((vec2(texel) + 0.5 - ends.xy) * mirror, turn.xy);
  float far = distance(start, place);
  if (!(far <= ACROSS_FARTHEST)) {
    discard;  // too far, or NaN from UVs far outside
  }
  // Stop where the island across ends: another one may begin behind it.
  for (float at = 1.0; at < far; at += 1.0) {
    if (across_texel(ivec2(floor(mix(start, place, at / far)))).a == 0.0) {
      discard;
    }
  }

  vec2 corner = kind == ACROSS_LABEL ? floor(place) : place - 0.5;
  vec2 part = corner - floor(corner);
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 4; i++) {
    ivec2 next = ivec2(i & 1, i >> 1);
    vec4 value = across_texel(ivec2(floor(corner)) + next);
    vec2 weight = mix(1.0 - part, part, vec2(next));
    if (value.a > 0.0) {
      sum += weight.x * weight.y * vec4(value.xyz, 1.0);
    }
  }
  if (sum.a <= 0.0) {
    discard;
  }
  vec3 value = sum.xyz / sum.a;
  if (kind == ACROSS_TANGENT) {
    // The similarity rotated the directions along the surface: rotate them back.
    value.xy = across_product(value.xy * mirror, normalize(turn.xy) * vec2(1.0, -turn.z));
  }
  if (kind >= ACROSS_NORMAL) {
    float length_squared = dot(value, value);
    if (!(length_squared > 0.0)) {
      discard;
    }
    value /= sqrt(length_squared);
  }
  map_out = vec4((encode * vec4(value, 1.0)).xyz, 1.0);
  state_out = STATE_MARGIN;
}
