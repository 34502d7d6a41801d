// Draws the texels that are turned, or that nothing covers, so that the depth test leaves them out.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  if (texel_at(normals, texel).a != 0.0 && texel_at(turned, texel).a == 0.0) {
    discard;
  }
  stopped_out = 1.0;
}
