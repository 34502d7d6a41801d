// Writes the rays of the texels again, so that each starts later: `gap` below its hit, or, without `from_hits`, below its texel.
#include "lib/hit_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 hit = texel_at(hits, texel);
  vec4 place = texel_at(positions, texel);
  float height = from_hits != 0 ? uintBitsToFloat(hit.w) : 0.0;
  position_out = from_hits != 0 && hit_missed(hit) ? vec4(0.0) : place;
  direction_out = vec4(texel_at(directions, texel).xyz, height - gap);
}
