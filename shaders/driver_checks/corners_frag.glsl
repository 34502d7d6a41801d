// Reads the corners of a texture, by its size.

void main()
{
  ivec2 size = texel_size(table);
  value_out = texel_at(table, ivec2(gl_FragCoord.xy) * (size - 1));
  size_out = vec4(vec2(size), 0.0, 0.0);
}
