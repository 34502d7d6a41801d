// Which normal a corner of the high meshes has. cast.upload arranges the texture `corners`.
#include "lib/texture_lib.glsl"

// The first number. The bits of smaller ones would be denormals, which a driver may flush to zero.
const int CORNER_FIRST = 1 << 23;

// The place in `normals` of a corner's normal. texel: of the corner.
ivec2 corner_normal(vec4 texel)
{
  return texture_place(floatBitsToInt(texel.w) - CORNER_FIRST);
}
