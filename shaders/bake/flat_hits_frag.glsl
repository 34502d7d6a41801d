// Writes the triangle on the texel and two barycentric coordinates, as shaders/lib/hit_lib.glsl reads them.

void main()
{
  hit_out = uvec4(uint(v_triangle) + 1u, floatBitsToUint(v_weights.x), floatBitsToUint(v_weights.y), 0u);
}
