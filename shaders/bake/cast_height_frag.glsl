// Writes the height of each hit above the low surface, along its ray. Alpha: 1 for a hit, -1 for a miss, 0 no low mesh.
// Green: 1 where no low triangle of the texel owns the hit. Blue: 1 where the ray hit only backs.
#include "lib/texture_lib.glsl"
#include "lib/hit_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  uvec4 hit = texel_at(hits, texel);
  bool missed = hit_missed(hit);
  float alpha = texel_at(positions, texel).a > 0.0 ? (missed ? -1.0 : 1.0) : 0.0;
  height_out = vec4(uintBitsToFloat(hit.w), (hit.x & HIT_NOT_OWNED) != 0u ? 1.0 : 0.0,
                    (hit.x & HIT_FROM_BEHIND) != 0u ? 1.0 : 0.0, alpha);
}
