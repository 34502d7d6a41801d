// Writes the mean visible direction, shorter than 1, or normalized. `normals` has the samples as accumulate_comp.glsl counts
// them, or a single one. Alpha: 1 known, 0 empty, -1 missed.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  float samples = texel_at(normals, texel).a;
  if (samples >= 1.0) {
    vec3 direction = mat3(normal_matrix) * texel_at(sums, texel).xyz;
    value_out = vec4(direction / (is_unit != 0 ? max(length(direction), 1e-30) : floor(samples) * rays), 1.0);
  }
  else {
    value_out = vec4(0.0, 0.0, 0.0, samples != 0.0 ? -1.0 : 0.0);
  }
}
