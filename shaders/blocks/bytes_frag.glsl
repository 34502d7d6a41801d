// Four bytes of a block in each texel, as colors: they are read back as bytes.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 block = texel_at(blocks, ivec2(texel.x / words, texel.y));
  uint word = block[texel.x % words];
  bytes_out = vec4((uvec4(word) >> uvec4(0u, 8u, 16u, 24u)) & 255u) / 255.0;
}
