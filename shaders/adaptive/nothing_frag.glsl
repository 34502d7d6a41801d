// Writes that nothing is known.

void main()
{
  nothing_out = vec4(0.0);
}
