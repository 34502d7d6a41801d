// Where high triangles are clear, because the alpha of their material is: rays go on there. A program that comes after this library
// asks, where others have nothing between #ifdef CUTOUTS and its end. `triangles` has a minus before the fourth number of each
// triangle that is not opaque, `cutouts` a texel for each triangle, with the number of its record: three more texels. passes/cutouts.py
// arranges them.
#include "lib/texture_lib.glsl"

#define CUTOUTS

const int CUTOUT_FIRST = 1 << 23;  // as TRIANGLE_FIRST

// Whether what is clear counts as solid: where a ray meets nothing else.
bool cutout_is_solid = false;

// Whether a triangle with this texel of `triangles` may be clear.
bool cutout_may_be(vec4 texel)
{
  return texel.w < 0.0 && !cutout_is_solid;
}

// The number of a texel of `triangles`, without what says that the triangle may be clear.
vec4 cutout_without_mark(vec4 texel)
{
  return vec4(texel.xyz, abs(texel.w));
}

// Whether a triangle that may be clear is so at the point with these barycentric coordinates. A record has the places of the corners
// in pixels; by how much the centers of pixels are off, and whether the image is repeated; its size, and the number of its first texel
// in `alphas`. That texel has the pixels at -1, -1 and to the right of it and above, less the threshold, and others follow.
bool cutout_hides_nothing(int triangle, vec2 weights)
{
  int record = floatBitsToInt(texelFetch(cutouts, texture_place(triangle), 0).x) - CUTOUT_FIRST;
  vec4 first = texelFetch(cutouts, texture_place(record), 0);
  vec4 second = texelFetch(cutouts, texture_place(record + 1), 0);
  vec4 shown = texelFetch(cutouts, texture_place(record + 2), 0);
  vec2 place = first.xy * (1.0 - weights.x - weights.y) + first.zw * weights.x + second.xy * weights.y - second.z;
  place = second.w > 0.0 ? place - floor(place / shown.xy) * shown.xy : clamp(place, vec2(-1.0), shown.xy);
  vec2 corner = floor(place);
  vec2 share = place - corner;
  int number = (int(corner.y) + 1) * (int(shown.x) + 2) + int(corner.x) + 1;
  vec4 pixels = texelFetch(alphas, texture_place(number + floatBitsToInt(shown.z) - CUTOUT_FIRST), 0);
  return mix(mix(pixels.x, pixels.y, share.x), mix(pixels.z, pixels.w, share.x), share.y) < 0.0;
}
