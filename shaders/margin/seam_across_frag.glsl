// Fills the margin beside a seam with values from across it. Discards other texels, which keep their values.
#include "lib/nearest_lib.glsl"
#include "lib/seam_lib.glsl"
#include "lib/state_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy) + ivec2(0, halo);
  if (texelFetch(values, texel, 0).a != 0.0) {
    discard;
  }
  ivec2 way = nearest_way(texel);
  if (max(abs(way.x), abs(way.y)) > reach) {
    discard;
  }
  ivec2 beside = seam_beside(texel, way);
  int border = int(texelFetch(borders, beside, 0).x + 0.5) - 1;
  if (border < 0 || seam_turn(border).w == 0.0) {
    discard;
  }
  ivec2 on_map = ivec2(0, first_row);
  if (is_deferred != 0) {
    map_out = vec4(float(border), vec2(way), seam_place(border, beside + on_map).y);
    state_out = STATE_DEFERRED;
    return;
  }
  vec4 value = seam_value(border, texel + on_map, beside + on_map);
  if (value.a == 0.0) {
    discard;
  }
  map_out = vec4((encode * vec4(value.xyz, 1.0)).xyz, 1.0);
  state_out = STATE_MARGIN;
}
