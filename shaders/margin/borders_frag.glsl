// Which border the texel lies beside; the nearest has passed the depth test.

void main()
{
  number_out = v_number;
}
