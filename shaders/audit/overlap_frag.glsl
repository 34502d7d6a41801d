// One for every triangle; blending adds them up.

void main()
{
  count_out = vec4(1.0);
}
