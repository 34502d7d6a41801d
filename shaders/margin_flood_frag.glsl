// One step of jump flooding (Rong and Tan 2006): ask the eight texels `jump` away for their nearest written texel.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  ivec2 size = textureSize(nearest, 0);
  ivec2 best = texelFetch(nearest, texel, 0).xy;
  ivec2 away = best - texel;
  int best_distance = best.x < 0 ? 0x7fffffff : away.x * away.x + away.y * away.y;

  // A written texel asks nobody. As the loop's end, not as a branch: software rasterisers leave a loop when no lane of
  // the group goes on, but compute both sides of a branch.
  int neighbours = best == texel ? 0 : 9;
  for (int i = 0; i < neighbours; i++) {
    ivec2 asked = texel + jump * ivec2(i % 3 - 1, i / 3 - 1);
    if (any(lessThan(asked, ivec2(0))) || any(greaterThanEqual(asked, size))) {
      continue;
    }
    ivec2 found = texelFetch(nearest, asked, 0).xy;
    ivec2 offset = found - texel;
    int found_distance = offset.x * offset.x + offset.y * offset.y;
    if (found.x >= 0 && found_distance < best_distance) {
      best = found;
      best_distance = found_distance;
    }
  }
  nearest_out = best;
}
