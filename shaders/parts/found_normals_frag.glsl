// Writes the normals that parts/merge_hits_comp.glsl has found, as bake/cast_lookup_frag.glsl does. Alpha: 1 hit, -1 missed, 0 no low
// mesh.
#include "lib/hit_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  if (hit_missed(texel_at(hits, texel))) {
    normal_out = vec4(0.0, 0.0, 0.0, texel_at(positions, texel).a > 0.0 ? -1.0 : 0.0);
  }
  else {
    vec3 normal = mat3(normal_matrix) * texel_at(found, texel).xyz;
    float length_squared = dot(normal, normal);
    normal_out = length_squared > 0.0 ? vec4(normal / sqrt(length_squared), 1.0) : vec4(0.0, 0.0, 0.0, -1.0);
  }
}
