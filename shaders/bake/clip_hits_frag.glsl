// Removes the hits of texels whose normal is not known.

void main()
{
  if (texel_at(normals, ivec2(gl_FragCoord.xy)).a != 0.0) {
    discard;
  }
  hit_out = uvec4(0u);
}
