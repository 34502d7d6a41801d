// Draws the unfinished map for the screen: nearest texels, encoded. `normals` can hold sums of samples.

void main()
{
  ivec2 size = textureSize(normals, 0);
  ivec2 texel = ivec2(gl_FragCoord.xy * scale.xy);
  vec4 normal = texelFetch(normals, min(texel, size - 1), 0);
  float length_squared = dot(normal.xyz, normal.xyz);
  if (normal.a == 0.0) {
    discard;  // not rendered yet: keep the old picture
  }
  if (scale.z > 0.0) {  // values, not normals
    picture_out = normal.a > 0.0 ? vec4(normal.xyz, 1.0) : vec4(0.0);
    return;
  }
  picture_out = length_squared > 0.0 ? vec4(mat3(channels) * normal.xyz / sqrt(length_squared) * 0.5 + 0.5, 1.0)
                                     : vec4(0.0);
}
