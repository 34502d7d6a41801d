// Writes the first level of an image: each pixel is the mean of the two by two pixels of the image that it covers, or of parts
// of up to three by three where a side is odd. Means are of scene-linear colors, multiplied by alpha where it weighs.
#include "lib/image_level_lib.glsl"
#include "lib/image_color_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  ivec2 size = textureSize(image_pixels, 0);
  if (any(greaterThanEqual(texel, (size + 1) / 2))) {
    return;
  }
  vec3 across = image_level_weights(texel.x, size.x);
  vec3 up = image_level_weights(texel.y, size.y);
  vec4 sum = vec4(0.0);
  for (int corner = 0; corner < 4; corner++) {
    ivec2 pixel = min(texel * 2 + ivec2(corner % 2, corner / 2), size - 1);
    float weight = (corner % 2 == 0 ? across.y : across.z) * (corner < 2 ? up.y : up.z);
    sum += weight * image_color_linear(image_color_weighed(texelFetch(image_pixels, pixel, 0)));
  }
  // The pixels to the left and below, of which only odd sides have a part.
  int more = any(greaterThan(vec2(across.x, up.x), vec2(0.0))) ? 5 : 0;
  for (int i = 0; i < more; i++) {
    ivec2 place = i < 3 ? ivec2(i, 0) : ivec2(0, i - 2);
    float weight = across[place.x] * up[place.y];
    ivec2 pixel = clamp(texel * 2 + place - 1, ivec2(0), size - 1);
    sum += weight * image_color_linear(image_color_weighed(texelFetch(image_pixels, pixel, 0)));
  }
  imageStore(levels, texel, sum);
}
