// As bake/cast_comp.glsl, but where a ray crosses as many layers of the high meshes as of the low one, they are matched by their
// order.

const bool CARRIED_GOES_ON = true;
const bool CAST_BY_ORDER = true;
#include "lib/cast_lib.glsl"

void main()
{
  cast_own();
}
