// Transforms the object-space normal of each texel into the tangent space of the low mesh.
#include "lib/early_lib.glsl"
#include "lib/basis_lib.glsl"

void main()
{
  vec4 object_normal = texel_at(normals, ivec2(gl_FragCoord.xy));
  if (object_normal.a <= 0.0) {
    normal_out = object_normal;  // empty or missed
    return;
  }
  // The map must be the exact inverse of how it is read. Cycles' Normal Map node normalizes the interpolated normal and not
  // the interpolated tangent; the MikkTSpace reference, which engines follow, normalizes neither.
  vec3 low_normal = normalize_normal != 0 ? normalize(v_normal) : v_normal;
  vec3 components = basis_components(object_normal.xyz, v_tangent.xyz, v_tangent.w, low_normal);
  float length_squared = dot(components, components);
  if (!(length_squared > 0.0) || isinf(length_squared)) {
    discard;
  }
  normal_out = vec4(components / sqrt(length_squared), 1.0);
}
