// Draws a bar from left to right; `rect` is its scale and offset in clip space.

void main()
{
  gl_Position = vec4(position * rect.xy + rect.zw, 0.0, 1.0);
  v_share = position.x;
}
