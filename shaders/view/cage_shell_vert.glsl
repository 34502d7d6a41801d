// Draws the low mesh moved along its ray directions, in world space: where rays start, or where they end.

void main()
{
  gl_Position = view_projection * vec4(position + direction * (start * scale + offset), 1.0);
}
