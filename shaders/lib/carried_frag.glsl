// Writes whether the last dispatch left texels unfinished.

void main()
{
  left_out = vec4(float(texel_at(carried, ivec2(0)).x), 0.0, 0.0, 0.0);
}
