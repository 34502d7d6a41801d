// Writes a value that is linear in the means of the sums. `normals` has the samples as accumulate_comp.glsl counts them, or a
// single one. Alpha: 1 known, 0 empty, -1 missed.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  float samples = texel_at(normals, texel).a;
  if (samples >= 1.0) {
    vec4 mean = texel_at(sums, texel) / (floor(samples) * rays);
    value_out = vec4(vec3(max(dot(factors, mean) + base, lowest)), 1.0);
  }
  else {
    value_out = vec4(0.0, 0.0, 0.0, samples != 0.0 ? -1.0 : 0.0);
  }
}
