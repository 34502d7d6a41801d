// Traces one ray per texel from outside the low mesh inwards, and takes the outermost hit on the high meshes that belongs to the
// texel.
#include "lib/active_lib.glsl"
#include "lib/search_lib.glsl"
#include "lib/owner_lib.glsl"
#include "lib/hit_lib.glsl"

// The most hits of a ray that are asked for their owner, so that no ray takes long.
const int CAST_CANDIDATES = 16;
// The least distance, in local space, between a hit and the next one.
const float CAST_BEYOND = 1e-8;

void main()
{
  ivec2 texel = active_texel(first_row, textureSize(positions, 0).x);
  if (any(greaterThanEqual(texel, textureSize(positions, 0)))) {
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

    bool facing = true, is_last = false;
    float first = 0.0;
    float wanted = 0.0;  // the hit nearest to this place on the ray is searched for
    uvec4 fallback = uvec4(0u);
    float fallback_distance = 1e30;
    for (int search = 0; search <= CAST_CANDIDATES; search++) {
      uvec4 hit = search_hit(texel, origin, direction, first, wanted, end, facing);
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
        facing = false;
        first = 0.0;
        wanted = start;
        continue;
      }
      float t = uintBitsToFloat(hit.w);
      ivec3 numbers = triangle_normals(texel_at(triangles, texture_place(hit_triangle(hit))));
      vec3 normal = TRIANGLE_MIXED(normals, numbers, hit_weights(hit)).xyz;
      if (owner_has_hit(origin + direction * t, normal, below.xyz, int(below.a) - 1, start - t > near)) {
        chosen = hit;
        break;
      }
      if (abs(t - start) < fallback_distance) {
        fallback_distance = abs(t - start);
        fallback = uvec4(hit.x | HIT_NOT_OWNED, hit.yzw);
      }
      chosen = fallback;
      first = t * (1.0 + OVERLAP_ROUNDING) + CAST_BEYOND;
    }
    chosen.w = chosen.x == 0u ? 0u : floatBitsToUint(start - uintBitsToFloat(chosen.w));
  }
  imageStore(hits, texel, chosen);
}
