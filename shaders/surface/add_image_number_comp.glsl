// As add_image_comp.glsl, for a map of numbers.
#include "lib/numbers/sums_lib.glsl"
#include "lib/adding_image_lib.glsl"

void main()
{
  adding_image();
}
