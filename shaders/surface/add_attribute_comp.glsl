// Adds an attribute of the high meshes, interpolated at each hit on a material that it feeds, to the sums of a map.
#include "lib/sums_lib.glsl"
#include "lib/adding_attribute_lib.glsl"

void main()
{
  adding_attribute();
}
