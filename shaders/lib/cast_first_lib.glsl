// Traces one ray per texel from outside the low mesh inwards, and takes the outermost hit on the high meshes, or the nearest one.
#include "lib/active_lib.glsl"
#include "lib/carried_lib.glsl"
#include "lib/search_lib.glsl"
#include "lib/hit_lib.glsl"

// Texels of a lane in `carried`.
const int CAST_FIRST_PARTS = 2;

void cast_first()
{
  ivec2 texel = active_texel(carried_row(), textureSize(positions, 0).x);
  if (any(greaterThanEqual(texel, textureSize(positions, 0)))) {
    return;
  }
  if (carried_stage() != CARRIED_ALL && imageLoad(hits, texel).x != HIT_UNFINISHED) {
    return;
  }
  vec4 below = texelFetch(positions, texel, 0);
  uvec4 hit = uvec4(0u);
  if (below.a > 0.0) {
    vec4 away = texelFetch(directions, texel, 0);
    float start = away.w;  // how far outside the low surface
    int turns = TURNS_MOST;
    SearchWalk walk;
    walk.node = -1;
    walk.trail = uvec2(0u);
    walk.hit = uvec4(0u);
    if (carried_stage() == CARRIED_ON) {
      uvec4 left = imageLoad(carried, carried_place(0, CAST_FIRST_PARTS));
      walk.node = int(left.x);
      walk.trail = left.yz;
      walk.hit = imageLoad(carried, carried_place(1, CAST_FIRST_PARTS));
    }
    search_hit(texel, below.xyz + away.xyz * start, -away.xyz, 0.0, is_nearest != 0 ? start : 0.0,
               min(max_t, start + inside), facing_only != 0, carried_stage() != CARRIED_ON, walk, turns);
    hit = walk.hit;
    hit.w = hit.x == 0u ? 0u : floatBitsToUint(start - uintBitsToFloat(hit.w));
    if (walk.node >= 0) {
      carried_note();
      hit = uvec4(HIT_UNFINISHED, 0u, 0u, 0u);
      if (carried_stage() != CARRIED_ALL) {
        imageStore(carried, carried_place(0, CAST_FIRST_PARTS), uvec4(uint(walk.node), walk.trail, 0u));
        imageStore(carried, carried_place(1, CAST_FIRST_PARTS), walk.hit);
      }
    }
  }
  imageStore(hits, texel, hit);
}
