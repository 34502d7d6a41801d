// The texel that a lane of a compute shader works on: one of a list, or one of all texels. The workgroups are squares of 8 x 8.
#include "lib/block_lib.glsl"
#include "lib/texture_lib.glsl"

// `width`: of the map. active_count: the length of the list, or -1 for all texels. `active_texels` has two places in a texel.
// Lanes beyond the list get a place outside of every map.
ivec2 active_texel(int row, int width)
{
  if (active_count < 0) {
    return block_texel(row);
  }
  int group = (int(gl_WorkGroupID.y) + row / 8) * ((width + 7) / 8) + int(gl_WorkGroupID.x);
  int lane = group * 64 + int(gl_LocalInvocationIndex);
  if (lane >= active_count) {
    return ivec2(1 << 24);
  }
  vec4 places = texelFetch(active_texels, texture_place(lane >> 1), 0);
  return ivec2((lane & 1) == 0 ? places.xy : places.zw);
}
