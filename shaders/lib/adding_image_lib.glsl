// Adds what an image shows at each hit on a material that it feeds to the sums of a map. row_u.w: the width of a sample, in
// texels. tile: the UDIM tile that the image is, or 0 for a single image.
#include "lib/footprint_lib.glsl"
#include "lib/served_lib.glsl"
#include "lib/image_lib.glsl"
#include "lib/fed_value_lib.glsl"

void adding_image()
{
  ivec2 texel = served_texel();
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  uvec4 hit = texel_at(hits, texel);
  FootprintUvs corners = footprint_uvs(max(hit_triangle(hit), 0));
  bool is_fed = !hit_missed(hit) && int(texelFetch(materials, texture_place(corners.material), 0).a) == feed;
  vec2 uv = footprint_uv(hit, corners);
  vec2 place = footprint_in_tile(footprint_mapped(uv), tile);
  is_fed = is_fed && (tile == 0 || !footprint_is_outside(place));
  if (is_fed) {
    mat2 footprint = footprint_of(texel, hit, uv, corners, footprint_to_pixels(textureSize(image_pixels, 0))) * row_u.w;
    vec3 value = fed_value_of(image_mean(place, image_axes(footprint)));
    sums_store(texel, sums_load(texel) + vec4(value, 1.0));
  }
}
