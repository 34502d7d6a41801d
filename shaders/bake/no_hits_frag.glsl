// Writes that nothing was hit.

void main()
{
  hit_out = uvec4(0u);
}
