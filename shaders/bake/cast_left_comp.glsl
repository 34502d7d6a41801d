// Goes on with the rays that bake/cast_comp.glsl has left.

const bool CARRIED_GOES_ON = true;
const bool CAST_BY_ORDER = false;
#include "lib/cast_lib.glsl"

void main()
{
  cast_own();
}
