// Compares the normal that a viewer sees of the low mesh with that of the high mesh on the same pixel. Red is 1 + the angle in
// degrees, or a negative number of seen_lib; green the distance along the view as a share of its depth; blue the number of the
// square of the map, from 1; alpha how much the low mesh faces the viewer, from 0 to 1, or that from -1 down where it
// shows a back face and the high mesh does not, neither there nor on a pixel beside it. The last column of `shading` has the
// columns and rows of squares on the map, the number of squares before those of this map, and which normals count: 0 for none,
// 1 for the mesh's own, 2 for those of the map.
#include "lib/seen_lib.glsl"
#include "lib/map_lib.glsl"

// Whether the high mesh shows a back face on a pixel or one beside it.
bool shows_back(ivec2 pixel)
{
  ivec2 last = texel_size(seen_high) - 1;
  for (int i = 0; i < 9; i++) {
    ivec2 beside = clamp(pixel + ivec2(i % 3, i / 3) - 1, ivec2(0), last);
    if (seen_is_back(texel_at(seen_high, beside).a)) {
      return true;
    }
  }
  return false;
}

void main()
{
  vec4 high = texel_at(seen_high, ivec2(gl_FragCoord.xy));
  vec4 how = shading[3];
  vec2 squares = clamp(floor(v_uv * how.xy), vec2(0.0), how.xy - 1.0);
  vec3 low = basis_unit(mat3(shading) * v_normal);
  vec3 away = basis_unit(vec3(view_projection[0].z, view_projection[1].z, view_projection[2].z));
  compared_out = vec4(SEEN_OTHERS, 0.0, how.z + 1.0 + squares.y * how.x + squares.x, abs(dot(low, away)));
  if (how.w > 0.5) {
    // On what it covers alone, it has another outline.
    if (!gl_FrontFacing && high.a >= SEEN_COVERED && !shows_back(ivec2(gl_FragCoord.xy))) {
      compared_out.w = -1.0 - compared_out.w;
    }
    if (how.w > 1.5) {
      low = map_normal(map_between(v_uv), v_normal, v_tangent, v_bitangent);
    }
    compared_out.x = SEEN_LOW_ALONE;
    if (high.a >= SEEN_COVERED) {
      compared_out.x = 1.0 + decode_degrees(seen_normal(low, gl_FrontFacing), high.xyz);
      compared_out.y = abs(gl_FragCoord.z + SEEN_COVERED + (seen_is_back(high.a) ? SEEN_BACK : 0.0) - high.a);
    }
  }
}
