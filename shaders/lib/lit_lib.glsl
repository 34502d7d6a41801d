// Lighting as in Gumbau, González and Chover, Algorithm 4: N . L and some ambient light, and a fill light from behind, which shows
// the shape of what the light does not reach.

const float LIT_DIFFUSE = 0.5;
const float LIT_AMBIENT = 0.04;
const float LIT_FILL = 0.12;

// `light`: the direction towards the light with w = 0, or its position with w = 1.
vec4 lit_color(vec3 normal, vec3 position, vec4 light)
{
  vec3 towards = normalize(light.xyz - position * light.w);
  float facing = dot(normal, towards);
  return vec4(vec3(LIT_AMBIENT + LIT_DIFFUSE * max(0.0, facing) + LIT_FILL * (0.5 - 0.5 * facing)), 1.0);
}
