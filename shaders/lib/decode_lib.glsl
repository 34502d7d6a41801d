// The normal that a stored color means. A reading of a map is three numbers: `steps` between 0 and 1 to which the map is rounded
// (0: not rounded), a DECODE_ `kind`, and the `axes` of the channels: digits in base 6 for +X, -X, +Y, -Y, +Z, -Z, with red in
// the lowest, plus DECODE_REBUILT_Z for programs that make z of x and y.
#include "lib/basis_lib.glsl"

const int DECODE_WORLD = 0;
const int DECODE_OBJECT = 1;
const int DECODE_TANGENT = 2;  // plus the flags of its basis
const int DECODE_REBUILT_Z = 216;

vec3 decode_rounded(vec3 stored, float steps)
{
  return steps > 0.0 ? floor(stored * steps + 0.5) / steps : stored;
}

// The unit normal, in object space, or for a world-space map in world space. normal, tangent, bitangent: of the low mesh.
vec3 decode_normal(vec3 stored, int kind, int axes, vec3 normal, vec4 tangent, vec3 bitangent)
{
  vec3 shown = vec3(0.0);
  int digits = axes;
  for (int channel = 0; channel < 3; channel++) {
    int axis = digits % 6;
    shown[axis / 2] = (stored[channel] * 2.0 - 1.0) * (axis % 2 == 0 ? 1.0 : -1.0);
    digits /= 6;
  }
  if (axes >= DECODE_REBUILT_Z) {
    shown.z = sqrt(max(0.0, 1.0 - dot(shown.xy, shown.xy)));
  }
  if (kind >= DECODE_TANGENT) {
    shown = basis_of(kind - DECODE_TANGENT, normal, tangent, bitangent) * shown;
  }
  return basis_unit(shown);
}

// In degrees: exact for small angles, where the arc cosine is not.
float decode_degrees(vec3 a, vec3 b)
{
  return 57.29577951308232 * 2.0 * atan(length(a - b), length(a + b));
}
