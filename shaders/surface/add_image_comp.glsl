// Adds what a page shows at each hit on a material that it feeds to the sums of a map. row_u.w: the width of a sample, in
// texels. tile: the UDIM tile that the page is, or 0 for a single image.
#include "lib/footprint_lib.glsl"
#include "lib/served_lib.glsl"
#include "lib/page_lib.glsl"
#include "lib/fed_value_lib.glsl"

void main()
{
  ivec2 texel = served_texel();
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  uvec4 hit = texel_at(hits, texel);
  vec4 last = texel_at(uvs, texture_place(max(hit_triangle(hit), 0) * 2 + 1));
  bool is_fed = !hit_missed(hit) && int(texel_at(materials, texture_place(int(last.z))).a) == feed;
  vec4 first = texel_at(uvs, texture_place(max(hit_triangle(hit), 0) * 2));
  vec2 uv = footprint_uv(hit, first, last);
  vec2 place = footprint_in_tile(footprint_mapped(uv), tile);
  is_fed = is_fed && (tile == 0 || !footprint_is_outside(place));
  if (is_fed) {
    mat2 footprint = footprint_of(texel, hit, uv, first, last, footprint_to_pixels(textureSize(page, 0))) * row_u.w;
    vec3 value = fed_value_of(page_mean(place, page_axes(footprint)));
    imageStore(sums, texel, imageLoad(sums, texel) + vec4(value, 1.0));
  }
}
