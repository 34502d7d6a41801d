// Shows the texels of a map, unlit. The framebuffer turns linear colors into sRGB: texels that are to look as they are stored
// are decoded first.

float texture_linear(float stored)
{
  return stored <= 0.04045 ? stored / 12.92 : pow((stored + 0.055) / 1.055, 2.4);
}

vec3 texture_fetched(ivec2 texel)
{
  ivec2 size = textureSize(stored_map, 0);
  return texelFetch(stored_map, (texel % size + size) % size, 0).rgb;
}

// Between the centers of the texels around. Samplers round the weights.
vec3 texture_between(vec2 place)
{
  vec2 weight = fract(place - 0.5);
  ivec2 texel = ivec2(floor(place - 0.5));
  return mix(mix(texture_fetched(texel), texture_fetched(texel + ivec2(1, 0)), weight.x),
             mix(texture_fetched(texel + ivec2(0, 1)), texture_fetched(texel + ivec2(1, 1)), weight.x),
             weight.y);
}

void main()
{
  vec2 place = v_uv * vec2(textureSize(stored_map, 0));
  vec2 texels_a_pixel = fwidth(place);
  vec3 averaged = texture(stored_map, v_uv).rgb;
  vec3 shown = takes_nearest != 0 ? texture_fetched(ivec2(floor(place)))
               : max(texels_a_pixel.x, texels_a_pixel.y) < 1.0 ? texture_between(place)
                                                               : averaged;
  shown = clamp((shown - levels.x) * levels.y, 0.0, 1.0);
  if (is_stored_color != 0) {
    shown = vec3(texture_linear(shown.r), texture_linear(shown.g), texture_linear(shown.b));
  }
  color_out = vec4(shown, 1.0);
}
