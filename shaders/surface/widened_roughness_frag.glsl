// Widens the roughness of a texel by the variance of the slopes in it. The alpha of a Beckmann lobe, which is the square of
// roughness, has alpha ^ 2 = variance of the slopes along x + that along y.

// The share of the moments that may come from rounding.
const float ROUNDING = 1e-6;

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  vec4 known = texel_at(roughness, texel);
  vec3 normal = texel_at(normals, texel).xyz;
  vec3 square = texel_at(squares, texel).xyz;
  vec3 product = texel_at(products, texel).xyz;
  float length_squared = dot(normal, normal);
  float along = 0.0;
  if (length_squared > 0.0) {
    along = (dot(square, normal * normal) + 2.0 * dot(product, normal * normal.yzx)) / length_squared;
  }
  float whole = dot(square, vec3(1.0));
  float variance = along > 0.0 ? max(whole - along - ROUNDING * whole, 0.0) / along : 0.0;
  float alpha = known.x * known.x;
  float widened = sqrt(sqrt(alpha * alpha + variance));
  value_out = vec4(vec3(clamp(widened, 0.0, 1.0)), known.a);
}
