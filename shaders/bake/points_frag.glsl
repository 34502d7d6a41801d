// Writes a point on the high surface, and the numbers of its object and its material.

void main()
{
  point_out = vec4(v_position, 1.0);
  labels_out = vec4(v_labels, 0.0, 1.0);
}
