// Writes which materials the hits of each block of the map show: in 4 x 24 bits, material m in bit m % 96.
#include "lib/texture_lib.glsl"
#include "lib/hit_lib.glsl"

// As in addon/passes/surface_tables.py.
const int BLOCK = 32;
const int BITS = 24;

void main()
{
  ivec2 block = ivec2(gl_FragCoord.xy);
  ivec2 size = texel_size(hits);
  uvec4 shown = uvec4(0u);
  ivec2 end = min((block + 1) * BLOCK, size);
  for (int y = block.y * BLOCK; y < end.y; y++) {
    for (int x = block.x * BLOCK; x < end.x; x++) {
      uvec4 hit = texel_at(hits, ivec2(x, y));
      int material = int(texel_at(labels, texture_place(max(hit_triangle(hit), 0))).y) % (BITS * 4);
      uvec4 word = uvec4(equal(ivec4(material / BITS), ivec4(0, 1, 2, 3)));
      shown |= word * (hit_missed(hit) ? 0u : 1u << uint(material % BITS));
    }
  }
  materials_out = vec4(shown);
}
