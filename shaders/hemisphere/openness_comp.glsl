// Adds rays from the point that each texel hit to the sums of what they see: xyz has the sum of the visible directions, w their
// number. Rays are distributed as the cosine to the normal, so that the mean is ambient occlusion.
#include "lib/block_lib.glsl"
#include "lib/lattice_lib.glsl"
#include "lib/shading_lib.glsl"
#include "lib/reach_lib.glsl"

// As in passes/hemisphere/openness.py, FADES.
const int OPENNESS_FADE_NONE = 0;
const int OPENNESS_FADE_SMOOTH = 2;
// Each ray counts the normal by this much, which gives a bent normal its direction where all rays are blocked.
const float OPENNESS_LEAST = 1e-6;

void main()
{
  float farthest = grid_scale.w;
  int fade = blocking.x;
  int sides = blocking.y;
  float floor_height = grid_origin.w;
  ivec2 texel = block_texel(first_row);
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  vec4 sum = numbers.w != 0 ? vec4(0.0) : imageLoad(sums, texel);
  uvec4 hit = texel_at(hits, texel);
  if (!hit_missed(hit)) {
    vec3 face = surface_face_normal(hit, vec3(0.0));
    vec3 normal = shading_normal(hit, vec3(0.0, 0.0, 1.0));
    vec3 origin = surface_point(hit) * placed.w + placed.xyz;
    origin += face * (sides == REACH_BOTH ? REACH_OFFSET : 0.0);
    int own = blocking.z != 0 ? hit_triangle(hit) : -1;
    vec2 shift = lattice_shift(texel, cell);
    for (int i = 0; i < numbers.y; i++) {
      vec2 point = lattice_point(numbers.x + i * numbers.z, steps.xyz, shift);
      vec3 direction = lattice_direction(sqrt(1.0 - point.x * steps.w), point.y, normal);
      bool is_open = dot(direction, face) > 0.0;
      // A ray that starts below the surface it belongs to is blocked. It gets no length, instead of a branch around the search.
      float end = is_open ? farthest : -1.0;
      if (is_open && direction.z < 0.0) {
        end = min(end, max((floor_height - origin.z) / direction.z, 0.0));
      }
      float reached = reach_distance(origin, direction, end, own, sides, fade == OPENNESS_FADE_NONE);
      float visible = reached >= farthest ? 1.0 : 0.0;
      if (fade != OPENNESS_FADE_NONE) {
        visible = clamp(reached / farthest, 0.0, 1.0);
        visible = fade == OPENNESS_FADE_SMOOTH ? visible * visible * (3.0 - 2.0 * visible) : visible;
      }
      sum += visible * vec4(direction, 1.0);
    }
    sum.xyz += normal * (OPENNESS_LEAST * float(numbers.y));
  }
  imageStore(sums, texel, sum);
}
