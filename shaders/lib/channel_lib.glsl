// Channels of colors, as core/material_feeds.py declares them.

const int CHANNEL_LUMINANCE = -1;
const int CHANNEL_AVERAGE = -2;
// As material_feeds.LUMINANCE_WEIGHTS.
const vec3 CHANNEL_WEIGHTS = vec3(0.2126390, 0.7151687, 0.0721923);

// One of the four channels, the luminance or the mean of the color; the color for any other number.
vec3 channel_of(vec4 color, int number)
{
  if (number == CHANNEL_LUMINANCE) {
    return vec3(dot(color.rgb, CHANNEL_WEIGHTS));
  }
  if (number == CHANNEL_AVERAGE) {
    return vec3((color.r + color.g + color.b) / 3.0);
  }
  vec3 red_or_green = number == 0 ? color.rrr : color.ggg;
  vec3 blue_or_alpha = number == 2 ? color.bbb : color.aaa;
  return number > 3 ? color.rgb : (number < 2 ? red_or_green : blue_or_alpha);
}
