// Draws the texels that take no more samples, so that the depth test leaves them out.

void main()
{
  if (texelFetch(rounds, ivec2(gl_FragCoord.xy), 0).r * 255.0 > number - 0.5) {
    discard;
  }
  nothing_out = 0.0;
}
