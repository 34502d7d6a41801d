// Writes a level of an image from the one before, as first_level_comp.glsl does. source, result: the origins of both in the
// texture, and their sizes.
#include "lib/image_level_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, ivec2(result.zw)))) {
    return;
  }
  vec3 across = image_level_weights(texel.x, int(source.z));
  vec3 up = image_level_weights(texel.y, int(source.w));
  ivec2 corner = ivec2(source.xy) + texel * 2 - 1;
  // Only odd sides have a part of a third pixel.
  ivec2 start = 1 - ivec2(source.zw) % 2;
  vec4 sum = vec4(0.0);
  for (int j = start.y; j < 3; j++) {
    for (int i = start.x; i < 3; i++) {
      float weight = across[i] * up[j];
      if (weight > 0.0) {
        sum += weight * imageLoad(levels, corner + ivec2(i, j));
      }
    }
  }
  imageStore(levels, ivec2(result.xy) + texel, sum);
}
