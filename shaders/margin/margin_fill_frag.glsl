// Writes the map as it is stored, and the state of each texel. Alpha is 1 for written texels and for the margin, which
// repeats the nearest written texel. Elsewhere alpha is 0, and the color is the flat normal or, where a ray missed, the color
// of misses: a hole filled from its surroundings would look like detail. Maps that fill misses repeat the nearest texel there as
// well: filtering reads colors where alpha is 0, and would mix the color of misses into the edges of leaves.
#include "lib/nearest_lib.glsl"
#include "lib/state_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy) + ivec2(0, halo);
  vec4 value = texel_at(values, texel);
  state_out = value.a > 0.0 ? STATE_WRITTEN : value.a < 0.0 ? STATE_MISSED : 0.0;
  if (value.a < 0.0 && fills_misses != 0) {
    ivec2 way = nearest_way(texel);
    if (way.x != MARGIN_NONE) {
      map_out = vec4((encode * vec4(texel_at(values, texel + way).xyz, 1.0)).xyz, 0.0);
      state_out = STATE_FILLED;
      return;
    }
  }
  if (value.a == 0.0) {
    ivec2 way = nearest_way(texel);
    bool in_reach = way.x != MARGIN_NONE;
    value = in_reach ? texel_at(values, texel + way) : vec4(0.0, 0.0, 1.0, 0.0);
    state_out = in_reach ? STATE_MARGIN : 0.0;
  }
  map_out = vec4(value.a < 0.0 ? missed.rgb : (encode * vec4(value.xyz, 1.0)).xyz, value.a > 0.0 ? 1.0 : 0.0);
}
