// Writes the interpolated normal of the high mesh at each hit. Alpha: 1 hit, -1 missed, 0 no low mesh.
#include "lib/hit_lib.glsl"
#include "lib/triangle_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 hit = texel_at(hits, texel);
  if (hit_missed(hit)) {
    normal_out = vec4(0.0, 0.0, 0.0, texel_at(positions, texel).a > 0.0 ? -1.0 : 0.0);
  }
  else {
    ivec3 numbers = triangle_normals(texel_at(triangles, texture_place(hit_triangle(hit))));
    vec3 normal = mat3(normal_matrix) * TRIANGLE_MIXED(normals, numbers, hit_weights(hit)).xyz;
    float length_squared = dot(normal, normal);
    normal_out = length_squared > 0.0 ? vec4(normal / sqrt(length_squared), 1.0) : vec4(0.0, 0.0, 0.0, -1.0);
  }
}
