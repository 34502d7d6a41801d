// The light of Gumbau, González and Chover, Algorithm 4: N . L, and a little from everywhere.

const float LIT_DIFFUSE = 0.5;
const float LIT_AMBIENT = 0.04;

// `light`: the direction towards it with w = 0, or its place with w = 1.
vec4 lit_color(vec3 normal, vec3 position, vec4 light)
{
  vec3 towards = normalize(light.xyz - position * light.w);
  return vec4(vec3(LIT_AMBIENT + LIT_DIFFUSE * max(0.0, dot(normal, towards))), 1.0);
}
