// Colors the texels of a mask, each with its true borders, over what was drawn.

void main()
{
  ivec2 size = textureSize(mask, 0);
  ivec2 texel = ivec2(floor(fract(v_uv) * vec2(size)));
  if (texelFetch(mask, clamp(texel, ivec2(0), size - 1), 0).r < 0.5) {
    discard;
  }
  color_out = color;
}
