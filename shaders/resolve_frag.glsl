// The map as it is stored: normal * 0.5 + 0.5, alpha 1 where it was written or lies in the margin. Elsewhere alpha is 0
// and the colour that of the flat normal or, where a ray missed, the one for that. Beside it where each value came from.
#include "margin_lib.glsl"

const float STATE_MARGIN = 1.0 / 255.0;
const float STATE_WRITTEN = 2.0 / 255.0;
const float STATE_MISSED = 3.0 / 255.0;

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy) + ivec2(0, halo);
  int last = textureSize(offsets, 0).y - 1;

  // The nearest written texel, at most `margin` away: the best of what the rows above and below have at this column.
  // A written texel finds itself at once, and no row is asked that is farther than what was found.
  int best = margin * margin + 1;
  ivec2 source = texel;
  for (int away = 0; away <= margin && away * away < best; away++) {
    for (int side = -1; side <= 1; side += 2) {
      int row = texel.y + side * away;
      int offset = row < 0 || row > last ? MARGIN_NONE : texelFetch(offsets, ivec2(texel.x, row), 0).x;
      int distance_squared = offset == MARGIN_NONE ? best : offset * offset + away * away;
      if (distance_squared < best) {
        best = distance_squared;
        source = ivec2(texel.x + offset, row);
      }
    }
  }

  bool in_reach = best <= margin * margin;
  vec4 normal = texelFetch(normals, source, 0);
  bool is_missed = best != 0 && texelFetch(normals, texel, 0).a < 0.0;
  if (is_missed) {
    // A hole stays one: filled from beside it, it would pass for detail.
    map_out = vec4(missed.rgb, 0.0);
    state_out = STATE_MISSED;
  }
  else if (in_reach) {
    map_out = vec4(mat3(channels) * normal.xyz * 0.5 + 0.5, 1.0);
    state_out = best == 0 ? STATE_WRITTEN : STATE_MARGIN;
  }
  else {
    map_out = vec4(mat3(channels) * vec3(0.0, 0.0, 1.0) * 0.5 + 0.5, 0.0);
    state_out = 0.0;
  }
}
