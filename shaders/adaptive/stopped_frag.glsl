// Draws the texels that take no more samples, so that the depth test leaves them out.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  float needed = texelFetch(rounds, texel, 0).r * 255.0;
  // Where the first samples found nothing, others may, if a triangle is near.
  bool is_empty = needed > 254.5 && texelFetch(covered, texel / covered_side, 0).r < 0.5;
  if (needed > number - 0.5 && !is_empty) {
    discard;
  }
  nothing_out = 0.0;
}
