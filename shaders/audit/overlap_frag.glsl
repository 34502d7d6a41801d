// Writes one step of 8 bits for each triangle; additive blending, which multiplies by alpha, counts them.

void main()
{
  count_out = vec4(1.0 / 255.0, 0.0, 0.0, 1.0);
}
