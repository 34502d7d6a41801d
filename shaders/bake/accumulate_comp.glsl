// Adds one sample of each texel to the sums.
#include "lib/sums_lib.glsl"
#include "lib/adding_sample_lib.glsl"

void main()
{
  adding_sample();
}
