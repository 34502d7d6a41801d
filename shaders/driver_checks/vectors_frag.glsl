// What Imprint asks of vectors that may have no length, or only what rounding leaves of one.
#include "lib/basis_lib.glsl"
#include "lib/direction_lib.glsl"

void main()
{
  vec3 vector = texel_at(table, ivec2(gl_FragCoord.xy)).xyz;
  unit_out = vec4(basis_unit(vector), direction_exists(dot(vector, vector)) ? 1.0 : 0.0);
  // A basis without volume.
  components_out = vec4(basis_components(vec3(1.0), mat3(vector, vector, vector)), 1.0);
}
