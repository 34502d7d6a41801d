// Transforms the object-space vector of each texel into the tangent space of the low mesh, as Blender's Vector Displacement node
// reads it: along the tangent, the normal and the bitangent.
#include "lib/early_lib.glsl"
#include "lib/basis_lib.glsl"

#ifndef in_basis_space
#define in_basis_space(v) (v)
#endif

void main()
{
  vec4 vector = texel_at(normals, ivec2(gl_FragCoord.xy));
  if (vector.a <= 0.0) {
    normal_out = vector;  // empty or missed
    return;
  }
  mat3 basis = basis_of(basis_flags, v_normal, v_tangent, v_bitangent);
  normal_out = vec4(basis_components(in_basis_space(vector.xyz), basis).xzy, 1.0);
}
