// As add_constants_comp.glsl, for a map of numbers.
#include "lib/numbers/sums_lib.glsl"
#include "lib/adding_constants_lib.glsl"

void main()
{
  adding_constants();
}
