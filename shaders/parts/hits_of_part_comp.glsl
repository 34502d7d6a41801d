// Copies the hits on one part of the high meshes, with the numbers that triangles have in it. Elsewhere there is no hit.
#include "lib/hit_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  uvec4 hit = texel_at(hits, texel);
  int triangle = hit_triangle(hit) - first_triangle;
  if (hit_missed(hit) || triangle < 0 || triangle >= count) {
    hit = uvec4(0u);
  }
  else {
    hit.x -= uint(first_triangle);
  }
  imageStore(of_part, texel, hit);
}
