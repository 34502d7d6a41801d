// What the stored values of an image mean. image_flags: IMAGE_COLOR_ flags, as in addon/passes/surface_tables.py.

// Colors are stored as sRGB.
const int IMAGE_COLOR_SRGB = 1;
// Colors count by their alpha, by which they are not multiplied yet.
const int IMAGE_COLOR_WEIGHS_ALPHA = 2;

// A stored value, ready to be averaged: multiplied by its alpha where that weighs.
vec4 image_color_weighed(vec4 stored)
{
  return (image_flags & IMAGE_COLOR_WEIGHS_ALPHA) != 0 ? vec4(stored.rgb * stored.a, stored.a) : stored;
}

// The inverse of image_color_weighed.
vec4 image_color_plain(vec4 color)
{
  return (image_flags & IMAGE_COLOR_WEIGHS_ALPHA) != 0 && color.a > 0.0 ? vec4(color.rgb / color.a, color.a) : color;
}

// A stored mean as a scene-linear one, both weighed. IEC 61966-2-1.
vec4 image_color_linear(vec4 color)
{
  if ((image_flags & IMAGE_COLOR_SRGB) == 0) {
    return color;
  }
  vec3 stored = image_color_plain(color).rgb;
  vec3 bright = pow((max(stored, vec3(0.04045)) + 0.055) / 1.055, vec3(2.4));
  vec3 linear = mix(bright, stored / 12.92, lessThanEqual(stored, vec3(0.04045)));
  return image_color_weighed(vec4(linear, color.a));
}
