// Long arrays in textures: element i is in row i / width.

const int TEXTURE_ROW_BITS = 12;

ivec2 texture_place(int i)
{
  return ivec2(i & ((1 << TEXTURE_ROW_BITS) - 1), i >> TEXTURE_ROW_BITS);
}
