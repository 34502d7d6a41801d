// The number of the triangle, unless it is one of those that were seen already: `above` and later.

void main()
{
  // In two parts, each small enough to be interpolated between three that are alike without another coming out.
  vec2 parts = round(v_number);
  float number = parts.x * 4096.0 + parts.y;
  float seen = texelFetch(above, ivec2(gl_FragCoord.xy), 0).x;
  if (seen > 0.0 && number >= seen) {
    discard;
  }
  number_out = number;
}
