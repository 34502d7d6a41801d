// The map as it is stored: normal * 0.5 + 0.5, alpha 1 where it was written or lies in the margin. Elsewhere it holds
// the flat normal with alpha 0. Beside it, for the report, where each value came from.

const float STATE_MARGIN = 1.0 / 255.0;
const float STATE_WRITTEN = 2.0 / 255.0;

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy) + ivec2(0, halo);
  ivec2 source = texelFetch(nearest, texel, 0).xy;
  ivec2 away = source - texel;
  bool written = source == texel;
  bool in_reach = source.x >= 0 && away.x * away.x + away.y * away.y <= margin * margin;

  vec3 normal = vec3(0.0, 0.0, 1.0);
  if (in_reach) {
    normal = texelFetch(normals, source, 0).xyz;
    normal.y *= green;
  }
  map_out = vec4(normal * 0.5 + 0.5, in_reach ? 1.0 : 0.0);
  state_out = written ? STATE_WRITTEN : (in_reach ? STATE_MARGIN : 0.0);
}
