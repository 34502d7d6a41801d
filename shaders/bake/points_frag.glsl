// A point of the high surface, and the numbers of its object and its material.

void main()
{
  point_out = vec4(v_position, 1.0);
  // Interpolated between three that are alike, and rounding apart they still are.
  labels_out = vec4(round(v_labels), 0.0, 1.0);
}
