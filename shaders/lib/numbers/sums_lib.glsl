// As lib/sums_lib.glsl, of a map of numbers, whose three channels are equal: the number and the count have a texture each.

vec4 sums_load(ivec2 texel)
{
  return vec4(vec3(imageLoad(sums, texel).x), imageLoad(weights, texel).x);
}

void sums_store(ivec2 texel, vec4 sum)
{
  imageStore(sums, texel, vec4(sum.x));
  imageStore(weights, texel, vec4(sum.a));
}
