// As seam_across_frag.glsl, for a list of texels of the whole map: each texel of the target is one of them. Alpha is 0 where the
// nearest texel is to stay.
#include "lib/seam_lib.glsl"

void main()
{
  ivec2 entry = ivec2(gl_FragCoord.xy);
  vec4 listed = texel_at(places, entry);
  int border = int(texel_at(borders, entry).x + 0.5);
  ivec2 texel = ivec2(listed.xy);
  vec4 value = seam_value(border, texel, seam_beside(texel, ivec2(listed.zw)));
  map_out = vec4((encode * vec4(value.xyz, 1.0)).xyz, value.a);
}
