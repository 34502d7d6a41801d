// Writes the ray of each texel: its point on the low mesh with the number of the triangle, from 1, and the unit direction away
// from the surface with the distance outside the surface at which the ray starts.
#include "lib/early_lib.glsl"
#include "lib/tree_lib.glsl"
#include "lib/closest_lib.glsl"
#include "lib/direction_lib.glsl"
#include "lib/turns_lib.glsl"

// Normals that differ by less, squared, are the same.
const float RAYS_SAME = 1e-10;

// The distance to the nearest hard edge, at most `most`. Among more than 12,000 edges whose boxes are closer than the nearest one,
// as in a fan, it is that to the nearest of the first ones.
float rays_edge_distance(vec3 point, float most)
{
  vec3 grid_point = (point - edge_origin.xyz) * edge_scale.xyz;
  vec3 unit = 1.0 / edge_scale.xyz;
  float best = most * most;
  uvec2 trail = uvec2(0u);
  int node = 0;
  int turns = TURNS_MOST;
  while (node >= 0 && turns > 0) {
    turns--;
    int leaf = 0;
    uint edges = tree_step(
        tree_closer(TREE_BOXES(edge_nodes, node), grid_point, unit, best), edge_first_leaf, node, trail, leaf);
    while (edges != 0u) {
      int edge = leaf + findLSB(edges);
      edges &= edges - 1u;
      vec3 start = texel_at(edge_ends, texture_place(edge * 2)).xyz;
      vec3 end = texel_at(edge_ends, texture_place(edge * 2 + 1)).xyz;
      vec3 to_edge = closest_on_segment(point, start, end) - point;
      best = min(best, dot(to_edge, to_edge));
    }
  }
  return sqrt(best);
}

void main()
{
  float smooth_length = length(v_smooth_normal);
  if (!direction_exists(smooth_length * smooth_length)) {
    discard;
  }
  vec3 direction = v_smooth_normal / smooth_length;
  float straight_length = length(v_straight_normal);
  vec3 straight = straight_length > 0.0 ? v_straight_normal / straight_length : direction;
  vec3 turn = straight - direction;
  if (dot(turn, turn) > RAYS_SAME) {
    float share = straight_share;
    if (blend_width > 0.0) {
      share = smoothstep(0.0, blend_width, rays_edge_distance(v_position, blend_width));
    }
    vec3 blended = mix(direction, straight, clamp(share + v_paint.y, 0.0, 1.0));
    float blended_length = length(blended);
    direction = blended_length > 0.0 ? blended / blended_length : straight;
  }
  float start = start_on_cage != 0 ? smooth_length : start_offset;
  position_out = vec4(v_position, v_number);
  direction_out = vec4(direction, start * v_paint.x);
}
