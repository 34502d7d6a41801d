// Writes a point on the high surface, and the numbers of its object and its material.

void main()
{
  point_out = vec4(v_position, 1.0);
  // Interpolating three equal numbers can change the last bits: round them back.
  labels_out = vec4(round(v_labels), 0.0, 1.0);
}
