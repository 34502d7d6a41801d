// Adds the constant colors of materials to the sums of a map, and counts misses.
#include "lib/texture_lib.glsl"
#include "lib/hit_lib.glsl"
#include "lib/accumulate_lib.glsl"

// As CONSTANT in addon/passes/surface_tables.py.
const int ADDING_CONSTANTS_NUMBER = 0;

void adding_constants()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  uvec4 hit = texel_at(hits, texel);
  vec4 sum = is_first != 0 ? vec4(0.0) : sums_load(texel);
  if (!hit_missed(hit)) {
    int material = int(texel_at(labels, texture_place(hit_triangle(hit))).y);
    vec4 shown = texel_at(materials, texture_place(material));
    if (int(shown.a) == ADDING_CONSTANTS_NUMBER) {
      sum += vec4(shown.rgb, 1.0);
    }
  }
  else if (texel_at(normals, texel).a < 0.0) {
    sum.a += ACCUMULATE_MISS;
  }
  sums_store(texel, sum);
}
