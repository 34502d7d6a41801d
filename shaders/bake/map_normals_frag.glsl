// Decodes a normal map on the texels of the low mesh: the unit normals that it shows, and how they fit.
#include "lib/map_lib.glsl"

// Shorter vectors have no direction: gray and NaN.
const float MAP_NORMALS_SHORTEST = 0.05;
// Only black and white are longer, which no unit normal is near.
const float MAP_NORMALS_LONGEST = 1.7;
// Instead of a length.
const float MAP_NORMALS_NO_DIRECTION = 2.0;
const float MAP_NORMALS_MISSED = 3.0;

void main()
{
  vec4 stored = texelFetch(normal_map, ivec2(gl_FragCoord.xy), 0);
  if (stored.a <= 0.0) {
    normal_out = vec4(0.0, 0.0, 0.0, -1.0);
    fit_out = vec4(MAP_NORMALS_MISSED);
    return;
  }
  float size = length(stored.rgb * 2.0 - 1.0);
  bool has_direction = size > MAP_NORMALS_SHORTEST && size < MAP_NORMALS_LONGEST;
  if (!has_direction) {
    normal_out = vec4(0.0);
    fit_out = vec4(MAP_NORMALS_NO_DIRECTION);
    return;
  }
  vec3 shown = map_normal(stored.rgb, v_normal, v_tangent, v_bitangent);
  vec3 surface = shading[3].x > 0.0 ? mat3(shading) * v_normal : v_normal;
  normal_out = vec4(shown, 1.0);
  fit_out = vec4(dot(shown, surface) > 0.0 ? size : -size);
}
