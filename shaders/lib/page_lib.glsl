// Reads a page: an image of a material of the high meshes, with its levels, as addon/passes/surface_tables.py builds them.
// page_flags has PAGE_ flags as well as those of page_color_lib.glsl; top_level is the number of levels beside the page.
#include "lib/page_color_lib.glsl"

// The closest pixel is shown, rather than interpolated.
const int PAGE_CLOSEST = 4;
// The digits of page_flags that say what is outside the page, as core.material_feeds.Extension.
const int PAGE_EXTENSION_SHIFT = 4;
const int PAGE_REPEAT = 0;
const int PAGE_EXTEND = 1;
const int PAGE_CLIP = 2;
const int PAGE_MIRROR = 3;
// The most places along the longer axis of a footprint that are averaged.
const int PAGE_MOST_TAPS = 16;
// A share of the next level that is not worth reading it.
const float PAGE_NO_SHARE = 1e-3;

int page_extension()
{
  return page_flags >> PAGE_EXTENSION_SHIFT;
}

// Coordinates that show the same place, within the page; for CLIP, at most a page outside.
vec2 page_wrapped(vec2 uv)
{
  int extension = page_extension();
  if (extension == PAGE_REPEAT) {
    return uv - floor(uv);
  }
  if (extension == PAGE_MIRROR) {
    vec2 half_period = uv * 0.5 - floor(uv * 0.5);
    return 1.0 - abs(half_period * 2.0 - 1.0);
  }
  return extension == PAGE_EXTEND ? clamp(uv, vec2(0.0), vec2(1.0)) : clamp(uv, vec2(-1.0), vec2(2.0));
}

// The pixels left, below, right and above of a place, in pixels of a level of this size, and the weights of each.
void page_around(vec2 place, ivec2 size, out ivec4 pixels, out vec4 weights)
{
  vec2 start = floor(place);
  vec2 share = place - start;
  pixels = ivec4(ivec2(start), ivec2(start) + 1);
  weights = vec4(1.0 - share, share);
  ivec4 sizes = ivec4(size, size);
  ivec4 below = ivec4(lessThan(pixels, ivec4(0)));
  ivec4 beyond = ivec4(greaterThanEqual(pixels, sizes));
  if (page_extension() == PAGE_REPEAT) {
    pixels += sizes * (below - beyond);
  }
  if (page_extension() == PAGE_CLIP) {
    weights *= vec4(1 - below - beyond);
  }
  pixels = clamp(pixels, ivec4(0), sizes - 1);
}

// The page as it is stored, interpolated or the closest pixel. Cycles interpolates stored colors, and makes them linear
// afterwards.
vec4 page_full(vec2 uv)
{
  ivec2 size = textureSize(page, 0);
  vec2 place = page_wrapped(uv) * vec2(size);
  place = (page_flags & PAGE_CLOSEST) != 0 ? floor(place) : place - 0.5;
  ivec4 pixels;
  vec4 weights;
  page_around(place, size, pixels, weights);
  vec4 sum = vec4(0.0);
  for (int corner = 0; corner < 4; corner++) {
    ivec2 pixel = ivec2(corner % 2 == 0 ? pixels.x : pixels.z, corner < 2 ? pixels.y : pixels.w);
    float weight = (corner % 2 == 0 ? weights.x : weights.z) * (corner < 2 ? weights.y : weights.w);
    sum += page_color_weighed(texelFetch(page, pixel, 0)) * weight;
  }
  return page_color_linear(sum);
}

// A level from 1 on, interpolated.
vec4 page_level(vec2 uv, int level)
{
  ivec2 whole = textureSize(page, 0);
  ivec2 size = (whole + (1 << level) - 1) >> level;
  ivec2 origin = ivec2(0, level == 1 ? 0 : (whole.y + 1) / 2);
  for (int below = 2; below < level; below++) {
    origin.x += (whole.x + (1 << below) - 1) >> below;
  }
  ivec4 pixels;
  vec4 weights;
  page_around(page_wrapped(uv) * vec2(size) - 0.5, size, pixels, weights);
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
vec3 page_axes(mat2 footprint)
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
float page_width(vec3 axes)
{
  return max(max(axes.z, length(axes.xy) / float(PAGE_MOST_TAPS)), 1.0);
}

// The mean of the page around `uv` within a footprint of these axes: scene-linear, not multiplied by alpha.
vec4 page_mean(vec2 uv, vec3 axes)
{
  float width = page_width(axes);
  int taps = clamp(int(ceil(length(axes.xy) / width - 0.01)), 1, PAGE_MOST_TAPS);
  float level = min(log2(width), float(top_level));
  vec2 apart = axes.xy / vec2(textureSize(page, 0)) / float(taps);
  int lower = int(level);
  float share = level - float(lower);
  share = share > PAGE_NO_SHARE ? share : 0.0;
  int last = share > 0.0 ? lower + 1 : lower;
  vec4 sum = vec4(0.0);
  for (int tap = 0; tap < taps; tap++) {
    vec2 place = uv + apart * (float(tap) - 0.5 * float(taps - 1));
    if (lower == 0) {
      sum += page_full(place) * (1.0 - share);
    }
    for (int i = max(lower, 1); i <= last; i++) {
      sum += page_level(place, i) * (i == lower ? 1.0 - share : share);
    }
  }
  return page_color_plain(sum / float(taps));
}
