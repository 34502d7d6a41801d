// Writes the interpolated normal of the high mesh at each hit. Alpha: 1 hit, -1 missed, 0 no low mesh.
#include "lib/texture_lib.glsl"
#include "lib/corner_lib.glsl"
#include "lib/hit_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 hit = texel_at(hits, texel);
  if (hit_missed(hit)) {
    normal_out = vec4(0.0, 0.0, 0.0, texel_at(positions, texel).a > 0.0 ? -1.0 : 0.0);
  }
  else {
    int first = hit_triangle(hit) * 3;
    vec2 weights = hit_weights(hit);
    vec3 normal = texel_at(normals, corner_normal(texel_at(corners, texture_place(first)))).xyz * (1.0 - weights.x - weights.y) +
                  texel_at(normals, corner_normal(texel_at(corners, texture_place(first + 1)))).xyz * weights.x +
                  texel_at(normals, corner_normal(texel_at(corners, texture_place(first + 2)))).xyz * weights.y;
    normal = mat3(normal_matrix) * normal;
    float length_squared = dot(normal, normal);
    normal_out = length_squared > 0.0 ? vec4(normal / sqrt(length_squared), 1.0) : vec4(0.0, 0.0, 0.0, -1.0);
  }
}
