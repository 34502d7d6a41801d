// What a feed makes of the color of an image or an attribute: limits, scale and offset, as core/material_feeds.py has them.
// low.a and high.a limit the color before luminance and mean weigh it.
#include "lib/channel_lib.glsl"

vec3 fed_value_of(vec4 color)
{
  if (channel < 0) {
    color.rgb = clamp(color.rgb, vec3(low.a), vec3(high.a));
  }
  return clamp(channel_of(color, channel), low.rgb, high.rgb) * scale.rgb + offset.rgb;
}
