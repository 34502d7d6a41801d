// Draws the low mesh in the viewport, with its texture coordinates.

void main()
{
  gl_Position = view_projection * vec4(position, 1.0);
  v_uv = uv;
}
