// The high meshes' interpolated normal where each ray hit. Alpha: 1 hit, -1 missed, 0 no low mesh here.
#include "texture_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 hit = texelFetch(hits, texel, 0);
  bool on_low = texelFetch(positions, texel, 0).a > 0.0;
  normal_out = vec4(0.0, 0.0, 0.0, on_low ? -1.0 : 0.0);
  if (hit.x != 0u) {
    int first = int(hit.x - 1u) * 3;
    vec2 weights = vec2(uintBitsToFloat(hit.y), uintBitsToFloat(hit.z));
    vec3 normal = texelFetch(normals, texture_place(first), 0).xyz * (1.0 - weights.x - weights.y) +
                  texelFetch(normals, texture_place(first + 1), 0).xyz * weights.x +
                  texelFetch(normals, texture_place(first + 2), 0).xyz * weights.y;
    normal = mat3(normal_matrix) * normal;
    float length_squared = dot(normal, normal);
    if (length_squared > 0.0) {
      normal_out = vec4(normal / sqrt(length_squared), 1.0);
    }
  }
}
