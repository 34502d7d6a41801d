// Writes the shading normal that a viewer sees, and 1 + the depth in alpha, and 2 more for back faces.
#include "lib/seen_lib.glsl"

void main()
{
  float side = gl_FrontFacing ? 0.0 : SEEN_BACK;
  seen_out = vec4(seen_normal(basis_unit(v_normal), gl_FrontFacing), side + SEEN_COVERED + gl_FragCoord.z);
}
