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
#ifdef CUTOUTS
      cutout_is_solid = left.w != 0u;
#endif
    }
    bool is_new = carried_stage() != CARRIED_ON;
#ifdef CUTOUTS
    // Once more, with what is clear as solid, if there is nothing else.
    for (bool has_ended = false; !has_ended;) {
#endif
      search_hit(texel, below.xyz + away.xyz * start, -away.xyz, 0.0, is_nearest != 0 ? start : 0.0,
                 min(max_t, start + inside), facing_only != 0, is_new, walk, turns);
#ifdef CUTOUTS
      has_ended = walk.node >= 0 || walk.hit.x != 0u || cutout_is_solid;
      cutout_is_solid = cutout_is_solid || !has_ended;
      is_new = true;
    }
#endif
    hit = walk.hit;
    hit.w = hit.x == 0u ? 0u : floatBitsToUint(start - uintBitsToFloat(hit.w));
    if (walk.node >= 0) {
      carried_note();
      hit = uvec4(HIT_UNFINISHED, 0u, 0u, 0u);
      if (carried_stage() != CARRIED_ALL) {
        uint state = 0u;
#ifdef CUTOUTS
        state = uint(cutout_is_solid);
#endif
        imageStore(carried, carried_place(0, CAST_FIRST_PARTS), uvec4(uint(walk.node), walk.trail, state));
        imageStore(carried, carried_place(1, CAST_FIRST_PARTS), walk.hit);
      }
    }
  }
  imageStore(hits, texel, hit);
}
