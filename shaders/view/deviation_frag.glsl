// Writes the angle, in degrees, between the normal of the high surface and the one that the low mesh shows on the same texel:
// with its map (red) and without (green). Alpha is 1 where both are known, -1 without a high surface, and -2 where the high
// surface is that of another place. truth_x, truth_y, truth_z: the columns of the matrix from the truth to world space.
#include "lib/map_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  vec4 wanted = texelFetch(truth, texel, 0);
  if (wanted.a <= 0.0) {
    deviation_out = vec4(0.0, 0.0, 0.0, -1.0);
    return;
  }
  ivec2 part = texel * textureSize(elsewhere, 0) / textureSize(truth, 0);
  if (texelFetch(elsewhere, part, 0).r > 0.5) {
    deviation_out = vec4(0.0, 0.0, 0.0, -2.0);
    return;
  }
  vec3 high = basis_unit(truth_x.xyz * wanted.x + truth_y.xyz * wanted.y + truth_z.xyz * wanted.z);
  vec3 shown = map_normal(map_stored(texel), v_normal, v_tangent, v_bitangent);
  vec3 bare = basis_unit(mat3(shading) * v_normal);
  deviation_out = vec4(decode_degrees(shown, high), decode_degrees(bare, high), 0.0, 1.0);
}
