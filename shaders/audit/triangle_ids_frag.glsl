// Writes the number of the triangle. Discards the triangles of earlier layers: the one in `above`, and higher numbers.

void main()
{
  // The number is in two parts, small enough that interpolating three equal values and rounding gives the value back.
  vec2 parts = round(v_number);
  float number = parts.x * 4096.0 + parts.y;
  float seen = texelFetch(above, ivec2(gl_FragCoord.xy), 0).x;
  if (seen > 0.0 && number >= seen) {
    discard;
  }
  number_out = number;
}
