// The high meshes' interpolated normal where each ray hit. Alpha: 1 hit, -1 missed, 0 no low mesh here.
#include "texture_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 hit = imageLoad(hits, texel);
  bool on_low = imageLoad(positions, texel).a > 0.0;
  normal_out = vec4(0.0, 0.0, 0.0, on_low ? -1.0 : 0.0);
  if (hit.x != 0u) {
    int first = int(hit.x - 1u) * 3;
    vec2 weights = vec2(uintBitsToFloat(hit.y), uintBitsToFloat(hit.z));
    vec3 normal = imageLoad(normals, texture_place(first)).xyz * (1.0 - weights.x - weights.y) +
                  imageLoad(normals, texture_place(first + 1)).xyz * weights.x +
                  imageLoad(normals, texture_place(first + 2)).xyz * weights.y;
    normal = mat3(normal_matrix) * normal;
    float length_squared = dot(normal, normal);
    if (length_squared > 0.0) {
      normal_out = vec4(normal / sqrt(length_squared), 1.0);
    }
  }
}
