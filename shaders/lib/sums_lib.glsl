// The sums of a map of colors or vectors: alpha counts samples, as in accumulate_lib.glsl.

vec4 sums_load(ivec2 texel)
{
  return imageLoad(sums, texel);
}

void sums_store(ivec2 texel, vec4 sum)
{
  imageStore(sums, texel, sum);
}
