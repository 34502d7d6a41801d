// Draws one transparent color.

void main()
{
  color_out = color;
}
