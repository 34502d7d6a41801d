// Adds an attribute of the high meshes, interpolated at each hit on a material that it feeds, to the sums of a map.
#include "lib/hit_lib.glsl"
#include "lib/triangle_lib.glsl"
#include "lib/fed_value_lib.glsl"

void adding_attribute()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  uvec4 hit = texel_at(hits, texel);
  if (hit_missed(hit)) {
    return;
  }
  int triangle = hit_triangle(hit);
  int material = int(texel_at(labels, texture_place(triangle)).y);
  if (int(texel_at(materials, texture_place(material)).a) != feed) {
    return;
  }
  ivec3 numbers = triangle_numbers(texel_at(value_triangles, texture_place(triangle)));
  vec4 value = TRIANGLE_MIXED(values, numbers, hit_weights(hit));
  sums_store(texel, sums_load(texel) + vec4(fed_value_of(value), 1.0));
}
