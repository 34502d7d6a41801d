// One color, seen through.

void main()
{
  color_out = color;
}
