// Draws the deviation of the nearest texel. At the border of an island, the center of that texel may lie outside the low
// mesh, without a deviation: then the nearest of the four texels around that has one counts.
#include "lib/ramp_lib.glsl"

void main()
{
  ivec2 size = textureSize(deviation, 0);
  vec2 place = v_uv * vec2(size);
  ivec2 first = ivec2(floor(place - 0.5));
  vec4 found = vec4(0.0);
  float nearest = 4.0;
  for (int i = 0; i < 4; i++) {
    ivec2 texel = first + ivec2(i % 2, i / 2);
    vec2 way = vec2(texel) + 0.5 - place;
    vec4 value = texelFetch(deviation, clamp(texel, ivec2(0), size - 1), 0);
    if (value.a != 0.0 && dot(way, way) < nearest) {
      nearest = dot(way, way);
      found = value;
    }
  }
  float angle = without_map != 0 ? found.g : found.r;
  vec3 unknown = found.a < -1.5 ? RAMP_ELSEWHERE : RAMP_UNKNOWN;
  color_out = vec4(found.a > 0.0 ? ramp_color(angle / limit) : unknown, 1.0);
}
