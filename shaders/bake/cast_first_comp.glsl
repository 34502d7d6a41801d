// Traces one ray per texel from outside the low mesh inwards, and takes the outermost hit on the high meshes, or the nearest one.
#include "lib/active_lib.glsl"
#include "lib/search_lib.glsl"

void main()
{
  ivec2 texel = active_texel(first_row, texel_size(positions).x);
  if (any(greaterThanEqual(texel, texel_size(positions)))) {
    return;
  }
  vec4 below = texel_at(positions, texel);
  uvec4 hit = uvec4(0u);
  if (below.a > 0.0) {
    vec4 away = texel_at(directions, texel);
    float start = away.w;  // how far outside the low surface
    hit = search_hit(texel, below.xyz + away.xyz * start, -away.xyz, 0.0, is_nearest != 0 ? start : 0.0,
                     min(max_t, start + inside), facing_only != 0);
    hit.w = hit.x == 0u ? 0u : floatBitsToUint(start - uintBitsToFloat(hit.w));
  }
  imageStore(hits, texel, hit);
}
