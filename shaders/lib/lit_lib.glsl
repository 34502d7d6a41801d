// Lighting as in Gumbau, González and Chover, Algorithm 4: N . L and some ambient light.

const float LIT_DIFFUSE = 0.5;
const float LIT_AMBIENT = 0.04;

// `light`: the direction towards the light with w = 0, or its position with w = 1.
vec4 lit_color(vec3 normal, vec3 position, vec4 light)
{
  vec3 towards = normalize(light.xyz - position * light.w);
  return vec4(vec3(LIT_AMBIENT + LIT_DIFFUSE * max(0.0, dot(normal, towards))), 1.0);
}
