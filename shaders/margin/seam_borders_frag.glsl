// Writes the number of the border beside the texel; the depth test keeps the nearest one.

void main()
{
  number_out = v_number;
}
