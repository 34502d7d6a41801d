// Every second pixel of a picture in both directions, beginning with the second one.

void main()
{
  half_out = texel_at(seen_high, 2 * ivec2(gl_FragCoord.xy) + 1);
}
