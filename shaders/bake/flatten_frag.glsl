// The interpolated normal of the high mesh, of length one (Algorithm 2); alpha says that the texel was written.

void main()
{
  float length_squared = dot(v_normal, v_normal);
  // Opposite corner normals cancel out somewhere between them: no direction, no texel. NaN fails the test as well.
  if (!(length_squared > 0.0)) {
    discard;
  }
  // Not normalize(): a reciprocal square root need not give back exactly 1 for exactly 1.
  normal_out = vec4(v_normal / sqrt(length_squared), 1.0);
}
