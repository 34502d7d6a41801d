// As fullscreen_vert.glsl, nearer than what is drawn with the depth test later, so that no driver has to compare equal depths.

void main()
{
  gl_Position = vec4(position, -0.5, 1.0);
}
