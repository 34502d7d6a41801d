// The low mesh moved along its directions: where rays start, or where they end. In world space.

void main()
{
  gl_Position = view_projection * vec4(position + direction * away, 1.0);
}
