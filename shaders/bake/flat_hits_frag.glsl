// Writes the triangle on the texel and two barycentric coordinates, as shaders/lib/hit_lib.glsl reads them.

void main()
{
#ifdef CUTOUTS
  if (cutout_may_be(texelFetch(triangles, texture_place(v_triangle), 0)) &&
      cutout_hides_nothing(v_triangle, v_weights)) {
    discard;
  }
#endif
  hit_out = uvec4(uint(v_triangle) + 1u, floatBitsToUint(v_weights.x), floatBitsToUint(v_weights.y), 0u);
}
