// Writes the mean visible direction, shorter than 1. `normals` has the samples as accumulate_comp.glsl counts them, or a single
// one. Alpha: 1 known, 0 empty, -1 missed.

// The length of the normal that stands for a bent normal where nothing is visible: any visible sample outweighs it.
const float BENT_NORMAL_BLOCKED = 1e-4;

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  vec4 normal = texel_at(normals, texel);
  if (normal.a >= 1.0) {
    vec3 mean = mat3(normal_matrix) * (texel_at(sums, texel).xyz / (floor(normal.a) * rays));
    float squared = dot(normal.xyz, normal.xyz);
    vec3 unit = squared > 0.0 ? normal.xyz / sqrt(squared) : vec3(0.0, 0.0, 1.0);
    value_out = vec4(dot(mean, mean) > 0.0 ? mean : unit * BENT_NORMAL_BLOCKED, 1.0);
  }
  else {
    value_out = vec4(0.0, 0.0, 0.0, normal.a != 0.0 ? -1.0 : 0.0);
  }
}
