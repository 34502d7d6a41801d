// Compares the first two samples of each texel with those of its neighbors, and writes in how many rounds the texel takes
// samples, or 255 where neither found anything. Also writes the mean of both samples where that is all, otherwise their sum as
// accumulate_comp.glsl has it.
#include "lib/accumulate_lib.glsl"

vec4 rounds_sum(ivec2 texel)
{
  // Beyond the map nothing is known, as at the border of an island.
  if (any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, texel_size(one)))) {
    return vec4(0.0);
  }
  vec4 a = texel_at(one, texel);
  vec4 b = texel_at(other, texel);
  return a.a > 0.0 && b.a > 0.0 ? vec4(a.xyz + b.xyz, 2.0) : vec4(0.0);
}

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  vec4 a = texel_at(one, texel);
  vec4 b = texel_at(other, texel);
  vec4 sum = vec4(0.0);
  sum += a.a > 0.0 ? vec4(a.xyz, 1.0) : vec4(0.0, 0.0, 0.0, a.a < 0.0 ? ACCUMULATE_MISS : 0.0);
  sum += b.a > 0.0 ? vec4(b.xyz, 1.0) : vec4(0.0, 0.0, 0.0, b.a < 0.0 ? ACCUMULATE_MISS : 0.0);
  vec4 left = rounds_sum(texel - ivec2(1, 0));
  vec4 right = rounds_sum(texel + ivec2(1, 0));
  vec4 below = rounds_sum(texel - ivec2(0, 1));
  vec4 above = rounds_sum(texel + ivec2(0, 1));
  float needed = most;
  if (sum.a >= 2.0 && min(min(left.a, right.a), min(below.a, above.a)) > 0.0) {
    vec3 along_u = left.xyz + right.xyz - 2.0 * sum.xyz;
    vec3 along_v = below.xyz + above.xyz - 2.0 * sum.xyz;
    // Where an edge parts both samples, sums can still be in line. Then the samples differ by more than the neighbors say.
    vec3 slope = 0.25 * ((right.xyz - left.xyz) * separation.x + (above.xyz - below.xyz) * separation.y);
    vec3 beyond = 4.0 * (a.xyz - b.xyz - slope);
    float squared = max(dot(beyond, beyond), max(dot(along_u, along_u), dot(along_v, along_v)));
    vec4 is_enough = step(vec4(squared), limits);
    needed = min(1.0 + dot(1.0 - is_enough, vec4(1.0)), most);
  }
  rounds_out = (a.a == 0.0 && b.a == 0.0 ? 255.0 : needed) / 255.0;
  sum_out = needed > 1.0 ? sum : vec4(sum.xyz / max(length(sum.xyz), 1e-30), 1.0);
}
