// Traces one ray per texel from outside the low mesh inwards, and takes the outermost hit on the high meshes, or the nearest one.
#include "lib/active_lib.glsl"
#include "lib/search_lib.glsl"

void main()
{
  ivec2 texel = active_texel(first_row, textureSize(positions, 0).x);
  if (any(greaterThanEqual(texel, textureSize(positions, 0)))) {
    return;
  }
  vec4 below = texelFetch(positions, texel, 0);
  uvec4 hit = uvec4(0u);
  if (below.a > 0.0) {
    vec4 away = texelFetch(directions, texel, 0);
    float start = away.w;  // how far outside the low surface
    hit = search_hit(texel, below.xyz + away.xyz * start, -away.xyz, 0.0, is_nearest != 0 ? start : 0.0,
                     min(max_t, start + inside), facing_only != 0);
    hit.w = hit.x == 0u ? 0u : floatBitsToUint(start - uintBitsToFloat(hit.w));
  }
  imageStore(hits, texel, hit);
}
