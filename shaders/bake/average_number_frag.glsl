// As average_frag.glsl, for a map of numbers.
#include "lib/mean_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  normal_out = mean_value(vec4(vec3(texel_at(sums, texel).x), texel_at(weights, texel).x));
}
