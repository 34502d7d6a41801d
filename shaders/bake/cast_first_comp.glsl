// Traces one ray per texel from outside the low mesh inwards, and takes the outermost hit on the high meshes, or the nearest one.

const bool CARRIED_GOES_ON = false;
#include "lib/cast_first_lib.glsl"

void main()
{
  cast_first();
}
