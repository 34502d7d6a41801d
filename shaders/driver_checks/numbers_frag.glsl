// Reads whole numbers from the bits of floats, as tables of triangles have them.
#include "lib/triangle_lib.glsl"

void main()
{
  vec4 texel = texel_at(table, texture_place(int(gl_FragCoord.x)));
  number_out = vec4(vec3(triangle_numbers(texel)), float(triangle_fourth(texel)));
}
