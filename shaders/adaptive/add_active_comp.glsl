// Adds one more sample of the texels of a list to their sums, as accumulate_comp.glsl does it for all.
#include "lib/accumulate_lib.glsl"
#include "lib/active_lib.glsl"

void main()
{
  ivec2 texel = active_texel(first_row, texel_size(normals).x);
  if (any(greaterThanEqual(texel, texel_size(normals)))) {
    return;
  }
  vec4 normal = texel_at(normals, texel);
  if (normal.a != 0.0) {
    vec4 more = normal.a > 0.0 ? vec4(normal.xyz, 1.0) : vec4(0.0, 0.0, 0.0, ACCUMULATE_MISS);
    imageStore(sums, texel, imageLoad(sums, texel) + more);
  }
}
