// Writes the number of the triangle. Discards the triangles of earlier layers: the one in `above`, and higher numbers.

void main()
{
  float seen = texelFetch(above, ivec2(gl_FragCoord.xy), 0).x;
  if (seen > 0.0 && v_number >= seen) {
    discard;
  }
  number_out = v_number;
}
