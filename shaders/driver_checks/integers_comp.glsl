// Writes whole numbers of each format that images of Imprint have.

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(texel, imageSize(hits)))) {
    return;
  }
  int place = texel.y * imageSize(hits).x + texel.x;
  imageStore(hits, texel, uvec4(uint(place), floatBitsToUint(float(place) + 0.5), 2147483648u + uint(place), 4294967295u));
  imageStore(offsets, texel, ivec4(place - 32000, 0, 0, 0));
  imageStore(source_rows, texel, ivec4((place - 100) * 65537, 0, 0, 0));
}
