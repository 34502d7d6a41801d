// Transforms the object-space normal of each texel into the tangent space of the low mesh.
#include "lib/early_lib.glsl"
#include "lib/basis_lib.glsl"
#include "lib/direction_lib.glsl"

#ifndef in_basis_space
#define in_basis_space(v) (v)
#endif

void main()
{
  vec4 object_normal = texel_at(normals, ivec2(gl_FragCoord.xy));
  if (object_normal.a <= 0.0) {
    normal_out = object_normal;  // empty or missed
    return;
  }
  // The map must be the exact inverse of how it is read.
  vec3 normal = in_basis_space(object_normal.xyz);
  vec3 components = basis_components(normal, basis_of(basis_flags, v_normal, v_tangent, v_bitangent));
  float length_squared = dot(components, components);
  if (!direction_exists(length_squared)) {
    discard;
  }
  normal_out = vec4(components / sqrt(length_squared), 1.0);
}
