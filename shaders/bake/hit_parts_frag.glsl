// Writes each hit as floats, which every driver reads back: two barycentric coordinates, and the triangle's number + 1 in two
// parts of 14 bits; a miss has 0.
#include "lib/texture_lib.glsl"
#include "lib/hit_lib.glsl"

void main()
{
  uvec4 hit = texel_at(hits, ivec2(gl_FragCoord.xy));
  uint number = hit.x & HIT_TRIANGLE;
  vec2 weights = hit_missed(hit) ? vec2(0.0) : hit_weights(hit);
  hit_out = vec4(weights, float(number & 16383u), float(number >> 14));
}
