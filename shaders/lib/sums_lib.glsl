// Sums of rays in the image `sums`, which a lane leaves as they are, but marked, where it has no turns any more. w is 0 or more.
// numbers.w has 1 to replace the sums.

const bool CARRIED_GOES_ON = true;
#include "lib/carried_lib.glsl"

// In place of w where it is 0, in sums that are marked; elsewhere w is negative then.
const float SUMS_MARKED_ZERO = -1e30;
// The texels of a lane in `carried`.
const int SUMS_PARTS = 3;

vec4 sums_before(ivec2 texel)
{
  return (numbers.w & 1) != 0 ? vec4(0.0) : imageLoad(sums, texel);
}

// Whether the lane has rays to cast in this stage. sum: to which it adds.
bool sums_begin(ivec2 texel, out vec4 sum)
{
  if (carried_stage() == CARRIED_ALL) {
    sum = sums_before(texel);
    return true;
  }
  sum = imageLoad(sums, texel);
  bool is_marked = sum.w < 0.0;
  sum.w = sum.w <= SUMS_MARKED_ZERO ? 0.0 : -sum.w;
  return is_marked;
}

// Goes on with the ray that a lane had begun, if there is one. to: where each of four rays ends so far.
void sums_go_on(inout int node, inout uvec2 trail, inout vec4 to, inout int ray, inout vec4 sum)
{
  if (carried_stage() == CARRIED_ON) {
    uvec4 left = imageLoad(carried, carried_place(0, SUMS_PARTS));
    node = int(left.x);
    trail = left.yz;
    ray = int(left.w);
    to = uintBitsToFloat(imageLoad(carried, carried_place(1, SUMS_PARTS)));
    sum = uintBitsToFloat(imageLoad(carried, carried_place(2, SUMS_PARTS)));
  }
}

// Leaves the rest to the next dispatch.
void sums_leave(ivec2 texel, int node, uvec2 trail, vec4 to, int ray, vec4 sum)
{
  carried_note();
  if (carried_stage() == CARRIED_ALL) {
    sum = sums_before(texel);
    sum.w = sum.w > 0.0 ? -sum.w : SUMS_MARKED_ZERO;
    imageStore(sums, texel, sum);
    return;
  }
  imageStore(carried, carried_place(0, SUMS_PARTS), uvec4(uint(node), trail, uint(ray)));
  imageStore(carried, carried_place(1, SUMS_PARTS), floatBitsToUint(to));
  imageStore(carried, carried_place(2, SUMS_PARTS), floatBitsToUint(sum));
}
