// The map as it is stored, alpha 1 where it was written or lies in the margin, which repeats the nearest written texel.
// Elsewhere alpha is 0 and the color that of the flat normal or, where a ray missed, the one for that: a hole stays one,
// since filled from beside it would pass for detail. Beside it where each value came from.
#include "lib/nearest_lib.glsl"
#include "lib/state_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy) + ivec2(0, halo);
  vec4 value = texel_at(values, texel);
  state_out = value.a > 0.0 ? STATE_WRITTEN : value.a < 0.0 ? STATE_MISSED : 0.0;
  if (value.a == 0.0) {
    ivec2 way = nearest_way(texel);
    bool in_reach = way.x != MARGIN_NONE;
    value = in_reach ? texel_at(values, texel + way) : vec4(0.0, 0.0, 1.0, 0.0);
    state_out = in_reach ? STATE_MARGIN : 0.0;
  }
  map_out = vec4(value.a < 0.0 ? missed.rgb : (encode * vec4(value.xyz, 1.0)).xyz, value.a > 0.0 ? 1.0 : 0.0);
}
