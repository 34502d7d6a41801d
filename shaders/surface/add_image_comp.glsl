// Adds what an image shows at each hit on a material that it feeds to the sums of a map. row_u.w: the width of a sample, in
// texels. tile: the UDIM tile that the image is, or 0 for a single image.
#include "lib/sums_lib.glsl"
#include "lib/adding_image_lib.glsl"

void main()
{
  adding_image();
}
