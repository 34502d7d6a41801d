// Goes on with the rays that bake/cast_first_comp.glsl has left.

const bool CARRIED_GOES_ON = true;
#include "lib/cast_first_lib.glsl"

void main()
{
  cast_first();
}
