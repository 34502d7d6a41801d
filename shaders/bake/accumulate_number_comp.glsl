// As accumulate_comp.glsl, for a map of numbers.
#include "lib/numbers/sums_lib.glsl"
#include "lib/adding_sample_lib.glsl"

void main()
{
  adding_sample();
}
