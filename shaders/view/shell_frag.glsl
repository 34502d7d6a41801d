// One colour, seen through.

void main()
{
  colour_out = colour;
}
