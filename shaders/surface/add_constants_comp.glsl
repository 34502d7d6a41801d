// Adds the constant colors of materials to the sums of a map, and counts misses.
#include "lib/sums_lib.glsl"
#include "lib/adding_constants_lib.glsl"

void main()
{
  adding_constants();
}
