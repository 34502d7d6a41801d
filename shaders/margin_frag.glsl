// How far along its own row the nearest written texel lies: 0 for a written texel, MARGIN_NONE where none is in reach.
// Together with a search along the column this gives the nearest of all, exactly.
#include "margin_lib.glsl"

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  int last = textureSize(normals, 0).x - 1;
  int found = texelFetch(normals, texel, 0).a > 0.0 ? 0 : MARGIN_NONE;
  for (int away = 1; away <= margin && found == MARGIN_NONE; away++) {
    if (texelFetch(normals, ivec2(max(texel.x - away, 0), texel.y), 0).a > 0.0) {
      found = -min(away, texel.x);
    }
    else if (texelFetch(normals, ivec2(min(texel.x + away, last), texel.y), 0).a > 0.0) {
      found = min(away, last - texel.x);
    }
  }
  offset_out = found;
}
