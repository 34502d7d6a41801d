// Writes 1 for each triangle; additive blending counts them.

void main()
{
  count_out = vec4(1.0);
}
