// Texture coordinates as positions (Gumbau, González and Chover, Algorithm 1).

// `to_clip` maps uv to clip space: xy scale, zw offset. For a whole map it is (2, 2, -1, -1); for a band of its rows the
// scale and offset of v are larger.
vec4 uvspace_position(vec2 uv, vec4 to_clip)
{
  return vec4(uv * to_clip.xy + to_clip.zw, 0.0, 1.0);
}
