// Draws a mesh in the viewport.

void main()
{
  gl_Position = view_projection * vec4(position, 1.0);
  v_position = position;
  v_normal = mat3(shading) * normal;
}
