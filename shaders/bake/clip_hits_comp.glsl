// Removes the hits of texels whose normal is not known.

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, texel_size(normals)))) {
    return;
  }
  if (texel_at(normals, texel).a == 0.0) {
    imageStore(hits, texel, uvec4(0u));
  }
}
