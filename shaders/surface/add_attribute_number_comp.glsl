// As add_attribute_comp.glsl, for a map of numbers.
#include "lib/numbers/sums_lib.glsl"
#include "lib/adding_attribute_lib.glsl"

void main()
{
  adding_attribute();
}
