// Traces one ray per texel from outside the low mesh inwards, and takes the outermost hit on the high meshes that belongs to the
// texel.
#include "lib/active_lib.glsl"
#include "lib/carried_lib.glsl"
#include "lib/search_lib.glsl"
#include "lib/owner_lib.glsl"
#include "lib/order_lib.glsl"
#include "lib/hit_lib.glsl"

// The most hits of a ray that are asked for their owner, so that no ray takes long.
const int CAST_CANDIDATES = 16;
// The least distance, in local space, between a hit and the next one.
const float CAST_BEYOND = 1e-8;
// Texels of a lane in `carried`.
const int CAST_PARTS = 5;
// What a lane does first when it goes on: a new search for a hit, one under way, or the search for the owner of a hit.
const int CAST_NEW = 0;
const int CAST_SEARCHES = 1;
const int CAST_ASKS = 2;

// The hit that has as many others before it as the texel's point has layers of the low mesh, if there are as many hits as layers,
// and at least two. Otherwise, and if no turns are left, x is 0.
uvec4 cast_by_order(ivec2 texel, vec3 origin, vec3 direction, float start, float end, inout int turns)
{
  uvec4 result = uvec4(0u);
  if (start < 0.0 || start > end) {  // the texel's point is not on the ray
    return result;
  }
  ivec2 layers = order_layers(origin, direction, start, end, turns);
  if (layers.x < 2 || layers.x > ORDER_MOST) {
    return result;
  }
  SearchWalk walk;
  walk.node = -1;
  walk.trail = uvec2(0u);
  walk.hit = uvec4(0u);
  float first = 0.0;
  int count = 0;
  bool is_end = false;
  while (!is_end && count <= layers.x) {
    search_hit(texel, origin, direction, first, 0.0, end, true, true, walk, turns);
    is_end = walk.node >= 0 || walk.hit.x == 0u;
    if (!is_end) {
      if (count == layers.y) {
        result = walk.hit;
      }
      count++;
      first = uintBitsToFloat(walk.hit.w) * (1.0 + OVERLAP_ROUNDING) + CAST_BEYOND;
    }
  }
  return walk.node < 0 && count == layers.x ? result : uvec4(0u);
}

void cast_own()
{
  ivec2 texel = active_texel(carried_row(), textureSize(positions, 0).x);
  if (any(greaterThanEqual(texel, textureSize(positions, 0)))) {
    return;
  }
  if (carried_stage() != CARRIED_ALL && imageLoad(hits, texel).x != HIT_UNFINISHED) {
    return;
  }
  vec4 below = texelFetch(positions, texel, 0);
  uvec4 chosen = uvec4(0u);
  if (below.a > 0.0) {
    vec4 away = texelFetch(directions, texel, 0);
    float start = away.w;  // how far outside the low surface
    vec3 direction = -away.xyz;
    vec3 origin = below.xyz + away.xyz * start;
    float end = min(max_t, start + inside);

    int turns = TURNS_MOST;
    int search = 0, first_task = CAST_NEW;
    bool is_last = false;
    float first = 0.0;
    uvec4 fallback = uvec4(0u);
    SearchWalk walk;
    walk.node = -1;
    walk.trail = uvec2(0u);
    walk.hit = uvec4(0u);
    OwnerWalk asked;
    asked.node = -1;
    if (carried_stage() == CARRIED_ON) {
      uvec4 left = imageLoad(carried, carried_place(0, CAST_PARTS));
      walk.hit = imageLoad(carried, carried_place(1, CAST_PARTS));
      fallback = imageLoad(carried, carried_place(2, CAST_PARTS));
      uvec4 closest = imageLoad(carried, carried_place(3, CAST_PARTS));
      uvec4 state = imageLoad(carried, carried_place(4, CAST_PARTS));
      first_task = int(state.x);
      search = int(state.y);
      is_last = (state.z & 1u) != 0u;
#ifdef CUTOUTS
      cutout_is_solid = state.z > 1u;
#endif
      first = uintBitsToFloat(state.w);
      walk.node = first_task == CAST_SEARCHES ? int(left.x) : -1;
      walk.trail = left.yz;
      asked.node = first_task == CAST_ASKS ? int(left.x) : -1;
      asked.trail = left.yz;
      asked.found = int(left.w);
      asked.closest = uintBitsToFloat(closest.xyz);
      asked.best = uintBitsToFloat(closest.w);
    }
    if (CAST_BY_ORDER && carried_stage() != CARRIED_ON) {
      chosen = cast_by_order(texel, origin, direction, start, end, turns);
      search = chosen.x != 0u ? CAST_CANDIDATES + 1 : 0;
    }
    for (; search <= CAST_CANDIDATES; search++) {
      // The hit nearest to `wanted` on the ray is searched for, which is its beginning until no hit that faces it belongs to the texel.
      float wanted = is_last ? start : 0.0;
      search_hit(texel, origin, direction, first, wanted, end, !is_last, first_task == CAST_NEW, walk, turns);
      first_task = CAST_NEW;
      if (walk.node >= 0) {
        break;
      }
      uvec4 hit = walk.hit;
#ifdef CUTOUTS
      bool is_missed = hit.x == 0u && (is_last || (fallback.x == 0u && facing_only != 0));
      if (is_missed && !cutout_is_solid) {  // nothing else is there: once more, with what is clear as solid
        cutout_is_solid = true;
        is_last = false;
        first = 0.0;
        continue;
      }
#endif
      if (is_last) {
        chosen = hit;
        if (hit.x != 0u) {
          chosen.x |= HIT_FROM_BEHIND;
        }
        break;
      }
      if (hit.x == 0u) {  // no more hits that face the ray
        if (fallback.x != 0u || facing_only != 0) {
          chosen = fallback;
          break;
        }
        is_last = true;
        first = 0.0;
        continue;
      }
      float t = uintBitsToFloat(hit.w);
      ivec3 numbers = triangle_normals(texel_at(triangles, texture_place(hit_triangle(hit))));
      vec3 normal = TRIANGLE_MIXED(normals, numbers, hit_weights(hit)).xyz;
      if (owner_has_hit(origin + direction * t, normal, below.xyz, int(below.a) - 1, start - t > near, asked, turns)) {
        chosen = hit;
        break;
      }
      if (asked.node >= 0) {
        break;
      }
      if (fallback.x == 0u || abs(t - start) < abs(uintBitsToFloat(fallback.w) - start)) {
        fallback = uvec4(hit.x | HIT_NOT_OWNED, hit.yzw);
      }
      chosen = fallback;
      first = t * (1.0 + OVERLAP_ROUNDING) + CAST_BEYOND;
    }
    chosen.w = chosen.x == 0u ? 0u : floatBitsToUint(start - uintBitsToFloat(chosen.w));
    if (walk.node >= 0 || asked.node >= 0) {
      carried_note();
      chosen = uvec4(HIT_UNFINISHED, 0u, 0u, 0u);
      if (carried_stage() != CARRIED_ALL) {
        bool asks = asked.node >= 0;
        uvec4 left = asks ? uvec4(uint(asked.node), asked.trail, uint(asked.found)) : uvec4(uint(walk.node), walk.trail, 0u);
        imageStore(carried, carried_place(0, CAST_PARTS), left);
        imageStore(carried, carried_place(1, CAST_PARTS), walk.hit);
        imageStore(carried, carried_place(2, CAST_PARTS), fallback);
        imageStore(carried, carried_place(3, CAST_PARTS), floatBitsToUint(vec4(asked.closest, asked.best)));
        uint last = uint(is_last);
#ifdef CUTOUTS
        last += cutout_is_solid ? 2u : 0u;
#endif
        imageStore(carried, carried_place(4, CAST_PARTS),
                   uvec4(uint(asks ? CAST_ASKS : CAST_SEARCHES), uint(search), last, floatBitsToUint(first)));
      }
    }
  }
  imageStore(hits, texel, chosen);
}
