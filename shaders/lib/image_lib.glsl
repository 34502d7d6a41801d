// Reads an image of a material of the high meshes, with its levels, as addon/passes/surface_tables.py builds them.
// image_flags has IMAGE_ flags as well as those of image_color_lib.glsl; top_level is the number of levels beside the image.
#include "lib/image_color_lib.glsl"

// The closest pixel is shown, rather than interpolated.
const int IMAGE_CLOSEST = 4;
// The digits of image_flags that say what is outside the image, as core.material_feeds.Extension.
const int IMAGE_EXTENSION_SHIFT = 4;
const int IMAGE_REPEAT = 0;
const int IMAGE_EXTEND = 1;
const int IMAGE_CLIP = 2;
const int IMAGE_MIRROR = 3;
// The most places along the longer axis of a footprint that are averaged.
const int IMAGE_MOST_TAPS = 16;
// A share of the next level that is not worth reading it.
const float IMAGE_NO_SHARE = 1e-3;

int image_extension()
{
  return image_flags >> IMAGE_EXTENSION_SHIFT;
}

// Coordinates that show the same place, within the image; for CLIP, at most an image outside.
vec2 image_wrapped(vec2 uv)
{
  int extension = image_extension();
  if (extension == IMAGE_REPEAT) {
    return uv - floor(uv);
  }
  if (extension == IMAGE_MIRROR) {
    vec2 half_period = uv * 0.5 - floor(uv * 0.5);
    return 1.0 - abs(half_period * 2.0 - 1.0);
  }
  return extension == IMAGE_EXTEND ? clamp(uv, vec2(0.0), vec2(1.0)) : clamp(uv, vec2(-1.0), vec2(2.0));
}

// The pixels left, below, right and above of a place, in pixels of a level of this size, and the weights of each.
void image_around(vec2 place, ivec2 size, out ivec4 pixels, out vec4 weights)
{
  vec2 start = floor(place);
  vec2 share = place - start;
  pixels = ivec4(ivec2(start), ivec2(start) + 1);
  weights = vec4(1.0 - share, share);
  ivec4 sizes = ivec4(size, size);
  ivec4 below = ivec4(lessThan(pixels, ivec4(0)));
  ivec4 beyond = ivec4(greaterThanEqual(pixels, sizes));
  if (image_extension() == IMAGE_REPEAT) {
    pixels += sizes * (below - beyond);
  }
  if (image_extension() == IMAGE_CLIP) {
    weights *= vec4(1 - below - beyond);
  }
  pixels = clamp(pixels, ivec4(0), sizes - 1);
}

// The image as it is stored, interpolated or the closest pixel. Cycles interpolates stored colors, and makes them linear
// afterwards.
vec4 image_full(vec2 uv)
{
  ivec2 size = textureSize(image_pixels, 0);
  vec2 place = image_wrapped(uv) * vec2(size);
  place = (image_flags & IMAGE_CLOSEST) != 0 ? floor(place) : place - 0.5;
  ivec4 pixels;
  vec4 weights;
  image_around(place, size, pixels, weights);
  vec4 sum = vec4(0.0);
  for (int corner = 0; corner < 4; corner++) {
    ivec2 pixel = ivec2(corner % 2 == 0 ? pixels.x : pixels.z, corner < 2 ? pixels.y : pixels.w);
    float weight = (corner % 2 == 0 ? weights.x : weights.z) * (corner < 2 ? weights.y : weights.w);
    sum += image_color_weighed(texelFetch(image_pixels, pixel, 0)) * weight;
  }
  return image_color_linear(sum);
}

// A level from 1 on, interpolated.
vec4 image_level(vec2 uv, int level)
{
  ivec2 whole = textureSize(image_pixels, 0);
  ivec2 size = (whole + (1 << level) - 1) >> level;
  ivec2 origin = ivec2(0, level == 1 ? 0 : (whole.y + 1) / 2);
  for (int below = 2; below < level; below++) {
    origin.x += (whole.x + (1 << below) - 1) >> below;
  }
  ivec4 pixels;
  vec4 weights;
  image_around(image_wrapped(uv) * vec2(size) - 0.5, size, pixels, weights);
  vec4 sum = vec4(0.0);
  for (int corner = 0; corner < 4; corner++) {
    ivec2 pixel = ivec2(corner % 2 == 0 ? pixels.x : pixels.z, corner < 2 ? pixels.y : pixels.w);
    float weight = (corner % 2 == 0 ? weights.x : weights.z) * (corner < 2 ? weights.y : weights.w);
    sum += texel_at(levels, (origin + pixel)) * weight;
  }
  return sum;
}

// The axes of the ellipse that a footprint, columns in pixels, makes of a circle of one texel: xy is the longer one, in
// pixels, z the length of the shorter one.
vec3 image_axes(mat2 footprint)
{
  vec2 a = footprint[0];
  vec2 b = footprint[1];
  // The eigenvalues of footprint * transpose(footprint).
  float p = a.x * a.x + b.x * b.x;
  float q = a.x * a.y + b.x * b.y;
  float r = a.y * a.y + b.y * b.y;
  float half_difference = 0.5 * (p - r);
  float root = sqrt(half_difference * half_difference + q * q);
  float longer = sqrt(0.5 * (p + r) + root);
  vec2 axis = p >= r ? vec2(half_difference + root, q) : vec2(q, root - half_difference);
  float size = length(axis);
  axis = size > 0.0 ? axis / size : vec2(1.0, 0.0);
  // The determinant is the product of both lengths; a difference of squares would lose the shorter one.
  float shorter = longer > 0.0 ? abs(a.x * b.y - a.y * b.x) / longer : 0.0;
  return vec3(axis * longer, shorter);
}

// The width in pixels, at least 1, of the places that are averaged along the longer one of `axes`.
float image_width(vec3 axes)
{
  return max(max(axes.z, length(axes.xy) / float(IMAGE_MOST_TAPS)), 1.0);
}

// The mean of the image around `uv` within a footprint of these axes: scene-linear, not multiplied by alpha.
vec4 image_mean(vec2 uv, vec3 axes)
{
  float width = image_width(axes);
  int taps = clamp(int(ceil(length(axes.xy) / width - 0.01)), 1, IMAGE_MOST_TAPS);
  float level = min(log2(width), float(top_level));
  vec2 apart = axes.xy / vec2(textureSize(image_pixels, 0)) / float(taps);
  int lower = int(level);
  float share = level - float(lower);
  share = share > IMAGE_NO_SHARE ? share : 0.0;
  int last = share > 0.0 ? lower + 1 : lower;
  vec4 sum = vec4(0.0);
  for (int tap = 0; tap < taps; tap++) {
    vec2 place = uv + apart * (float(tap) - 0.5 * float(taps - 1));
    if (lower == 0) {
      sum += image_full(place) * (1.0 - share);
    }
    for (int i = max(lower, 1); i <= last; i++) {
      sum += image_level(place, i) * (i == lower ? 1.0 - share : share);
    }
  }
  return image_color_plain(sum / float(taps));
}
