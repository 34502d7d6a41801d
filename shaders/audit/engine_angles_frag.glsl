// Writes the angle, in degrees, between the normal that a map means and the one that another program shows of what is kept of it. own, other:
// the steps, kind and axes of decode_lib. Adds 1, because 0 is what the low mesh does not cover.
#include "lib/decode_lib.glsl"

void main()
{
  vec3 stored = texel_at(normal_map, ivec2(gl_FragCoord.xy)).rgb;
  vec3 meant = decode_normal(stored, int(own.y), int(own.z), v_normal, v_tangent, v_bitangent);
  vec3 kept = texel_at(kept_map, ivec2(gl_FragCoord.xy)).rgb;
  vec3 rounded = decode_rounded(kept, other.x);
  vec3 shown = decode_normal(rounded, int(other.y), int(other.z), v_normal, v_tangent, v_bitangent);
  angle_out = 1.0 + decode_degrees(meant, shown);
}
