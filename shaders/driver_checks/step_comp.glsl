// Moves texels to the next place and adds 1 to them. Texels come from other workgroups of the dispatch before.

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  ivec2 size = texel_size(source);
  if (any(greaterThanEqual(texel, size))) {
    return;
  }
  ivec2 place = ivec2((texel.x + size.x - 1) % size.x, (texel.y + 3) % size.y);
  imageStore(into, texel, texel_at(source, place) + vec4(1.0));
}
