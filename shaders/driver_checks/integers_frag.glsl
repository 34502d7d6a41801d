// Reads what integers_comp has written, as floats that hold all of it.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 hit = texel_at(hits, texel);
  int row = texel_at(source_rows, texel).x;
  unsigned_out = vec4(float(hit.x), uintBitsToFloat(hit.y), float(hit.z >> 8u), float(hit.w >> 16u));
  signed_out = vec4(float(texel_at(offsets, texel).x), float(row >> 16), float(row & 65535), float(hit.z & 255u));
}
