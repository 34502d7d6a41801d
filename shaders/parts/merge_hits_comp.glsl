// Keeps the better of two hits of a ray: the one on a part of the high meshes, and the best on other parts. Writes its normal, too.
#include "lib/active_lib.glsl"
#include "lib/hit_lib.glsl"
#include "lib/triangle_lib.glsl"

// Hits that belong to the texel come before others, and these before backs.
uint merge_class(uvec4 hit)
{
  return (hit.x & HIT_FROM_BEHIND) != 0u ? 2u : (hit.x & HIT_NOT_OWNED) != 0u ? 1u : 0u;
}

bool merge_is_better(uvec4 hit, uvec4 best)
{
  if (best.x == 0u) {
    return true;
  }
  uint class_of_hit = merge_class(hit), class_of_best = merge_class(best);
  if (class_of_hit != class_of_best) {
    return class_of_hit < class_of_best;
  }
  float height = uintBitsToFloat(hit.w), best_height = uintBitsToFloat(best.w);
  bool is_nearer = abs(height) < abs(best_height), is_as_near = abs(height) == abs(best_height);
  if (class_of_hit == 0u && is_nearest == 0) {
    is_nearer = height > best_height;
    is_as_near = height == best_height;
  }
  // As in a single tree, where a ray keeps the first of several hits.
  return is_nearer || (is_as_near && (hit.x & HIT_TRIANGLE) < (best.x & HIT_TRIANGLE));
}

void main()
{
  ivec2 texel = active_texel(first_row, texel_size(part_hits).x);
  if (any(greaterThanEqual(texel, texel_size(part_hits)))) {
    return;
  }
  uvec4 hit = texel_at(part_hits, texel);
  if (hit.x == 0u) {
    if (is_first != 0) {
      imageStore(hits, texel, hit);
    }
    return;
  }
  int triangle = hit_triangle(hit);
  hit.x += uint(first_triangle);
  if (is_first != 0 || merge_is_better(hit, imageLoad(hits, texel))) {
    vec3 normal = TRIANGLE_NORMAL(corners, normals, triangle, hit_weights(hit));
    imageStore(hits, texel, hit);
    imageStore(found, texel, vec4(normal, 1.0));
  }
}
