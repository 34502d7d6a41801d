// Adds rays from the point that each texel hit to the sums of what they see: xyz has the sum of the visible directions, w their
// number. Rays are distributed as the cosine to the normal, so that the mean is ambient occlusion.
#include "lib/block_lib.glsl"
#include "lib/lattice_lib.glsl"
#include "lib/shading_lib.glsl"
#include "lib/reach_lib.glsl"
#include "lib/sums_lib.glsl"

// As in passes/hemisphere.py, FADES.
const int OPENNESS_FADE_NONE = 0;
const int OPENNESS_FADE_SMOOTH = 2;
// The bits of blocking.z: the triangles that block are those of the surface, and rays do not start on edges.
const int OPENNESS_OF_SURFACE = 1;
const int OPENNESS_FROM_INSIDE = 2;
// Each ray counts the normal by this much, which gives a bent normal its direction where all rays are blocked.
const float OPENNESS_LEAST = 1e-6;

void main()
{
  float farthest = grid_scale.w;
  int fade = blocking.x;
  int sides = blocking.y;
  float floor_height = grid_origin.w;
  ivec2 texel = block_texel(carried_row());
  if (any(greaterThanEqual(texel, textureSize(hits, 0)))) {
    return;
  }
  vec4 sum;
  if (!sums_begin(texel, sum)) {
    return;
  }
  uvec4 hit = texelFetch(hits, texel, 0);
  if (!hit_missed(hit)) {
    vec3 normal = shading_normal(hit, vec3(0.0, 0.0, 1.0));
    vec3 face = surface_face_normal(hit, normal);
    vec3 origin = ((blocking.z & OPENNESS_FROM_INSIDE) != 0 ? surface_start(hit) : surface_point(hit)) * placed.w + placed.xyz;
    origin += face * (sides == REACH_BOTH ? REACH_OFFSET : 0.0);
    int own = (blocking.z & OPENNESS_OF_SURFACE) != 0 ? hit_triangle(hit) : -1;
    vec2 shift = lattice_shift(texel + ivec2(0, numbers.w >> 1), cell);
    int turns = TURNS_MOST;
    int i = 0;
    ReachWalk walk;
    walk.node = -1;
    sums_go_on(walk.node, walk.trail, walk.to, i, sum);
    for (; i < numbers.y; i += REACH_RAYS) {
      vec4 u;
      vec4 v;
      vec4 x;
      vec4 y;
      vec4 z;
      lattice_points(numbers.x + i * numbers.z, numbers.z, steps.xyz, shift, u, v);
      vec4 exists = lattice_exists(numbers.y - i);
      lattice_directions(sqrt(1.0 - u * steps.w), v, normal, x, y, z);
      // Rays that start below the surface they belong to are blocked. They get no length, instead of a branch.
      bvec4 is_open = lessThan(vec4(0.0), exists * (x * face.x + y * face.y + z * face.z));
      vec4 to_floor = mix(vec4(farthest), (floor_height - origin.z) / z, lessThan(z, vec4(0.0)));
      vec4 end = mix(vec4(-1.0), clamp(to_floor, 0.0, farthest), is_open);
      vec4 reached = reach_distances(origin, x, y, z, end, own, sides, fade == OPENNESS_FADE_NONE, walk, turns);
      if (walk.node >= 0) {
        break;
      }
      vec4 visible = vec4(greaterThanEqual(reached, vec4(farthest)));
      if (fade != OPENNESS_FADE_NONE) {
        visible = reached / farthest;
        visible = fade == OPENNESS_FADE_SMOOTH ? visible * visible * (3.0 - 2.0 * visible) : visible;
      }
      sum += vec4(dot(visible, x), dot(visible, y), dot(visible, z), dot(visible, vec4(1.0)));
    }
    if (walk.node >= 0) {
      sums_leave(texel, walk.node, walk.trail, walk.to, i, sum);
      return;
    }
    sum.xyz += normal * (OPENNESS_LEAST * float(blocking.w));
  }
  imageStore(sums, texel, sum);
}
