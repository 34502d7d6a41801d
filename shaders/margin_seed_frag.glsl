// Starts the flood: a written texel is its own nearest one, any other has none yet.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  nearest_out = texelFetch(normals, texel, 0).a > 0.0 ? texel : ivec2(-1);
}
