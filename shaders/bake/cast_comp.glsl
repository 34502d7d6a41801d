// Traces one ray per texel from outside the low mesh inwards, and takes the outermost hit on the high meshes that belongs to the
// texel.

const bool CARRIED_GOES_ON = false;
const bool CAST_BY_ORDER = false;
#include "lib/cast_lib.glsl"

void main()
{
  cast_own();
}
