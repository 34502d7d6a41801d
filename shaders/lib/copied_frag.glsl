// Copies a texture texel by texel.

void main()
{
  copied_out = texel_at(source, ivec2(gl_FragCoord.xy));
}
