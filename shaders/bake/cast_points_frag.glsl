// Writes the point on the high surface that each ray hit, and the numbers of its object, its material and its part.
#include "lib/surface_lib.glsl"

void main()
{
  uvec4 hit = texel_at(hits, ivec2(gl_FragCoord.xy));
  if (hit_missed(hit)) {
    discard;
  }
  point_out = vec4(surface_point(hit), 1.0);
  labels_out = vec4(texel_at(labels, texture_place(hit_triangle(hit))).xyz, 1.0);
}
