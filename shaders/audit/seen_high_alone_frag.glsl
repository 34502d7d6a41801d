// Marks what the high mesh covers, before the low mesh is drawn over it.
#include "lib/seen_lib.glsl"

void main()
{
  bool is_covered = texel_at(seen_high, ivec2(gl_FragCoord.xy)).a >= SEEN_COVERED;
  compared_out = vec4(is_covered ? SEEN_HIGH_ALONE : SEEN_NOTHING, 0.0, 0.0, 0.0);
}
