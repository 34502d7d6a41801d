// Texture coordinates as positions (Gumbau, González and Chover, Algorithm 1).

// `window` maps uv to clip space: xy scale, zw offset. For a whole map it is (2, 2, -1, -1); for a band of its rows the
// scale and offset of v are larger.
vec4 uvspace_position(vec2 uv, vec4 window)
{
  return vec4(uv * window.xy + window.zw, 0.0, 1.0);
}
