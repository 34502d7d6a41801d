// Writes the shading normal that a viewer sees, and 1 + the depth in alpha.
#include "lib/seen_lib.glsl"

void main()
{
  seen_out = vec4(seen_normal(basis_unit(v_normal), gl_FrontFacing), SEEN_COVERED + gl_FragCoord.z);
}
