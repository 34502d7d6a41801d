// Writes the first level of a page: each pixel is the mean of the two by two pixels of the page that it covers, or of parts
// of up to three by three where a side is odd. Means are of scene-linear colors, multiplied by alpha where it weighs.
#include "lib/page_level_lib.glsl"
#include "lib/page_color_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  ivec2 size = textureSize(page, 0);
  if (any(greaterThanEqual(texel, (size + 1) / 2))) {
    return;
  }
  vec3 across = page_level_weights(texel.x, size.x);
  vec3 up = page_level_weights(texel.y, size.y);
  // Only odd sides have a part of a third pixel.
  ivec2 start = 1 - size % 2;
  vec4 sum = vec4(0.0);
  for (int j = start.y; j < 3; j++) {
    for (int i = start.x; i < 3; i++) {
      float weight = across[i] * up[j];
      if (weight > 0.0) {
        sum += weight * page_color_linear(page_color_weighed(texelFetch(page, texel * 2 + ivec2(i, j) - 1, 0)));
      }
    }
  }
  imageStore(levels, texel, sum);
}
