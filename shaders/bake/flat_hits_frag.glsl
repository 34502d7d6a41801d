// Writes the triangle on the texel and two barycentric coordinates, as shaders/lib/hit_lib.glsl reads them.

void main()
{
  // Interpolating three equal numbers can change the last bits: round them back.
  uvec2 parts = uvec2(round(v_number));
  hit_out = uvec4((parts.x << 12) + parts.y + 1u, floatBitsToUint(v_weights.x), floatBitsToUint(v_weights.y), 0u);
}
