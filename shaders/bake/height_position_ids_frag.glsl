// A map beside the normal map, from the point on the low surface and the one on the high surface. `map_index` is one of these,
// as declared in addon/core/map_types.py.
const int INDEX_POSITION = 0;
const int INDEX_HEIGHT = 1;
const int INDEX_DISPLACEMENT = 2;
const int INDEX_DISTANCE = 3;
const int INDEX_COVERAGE = 4;
const int INDEX_OBJECT_ID = 5;
const int INDEX_MATERIAL_ID = 6;
const int INDEX_PART_ID = 7;
const int INDEX_GRADIENT = 8;

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  vec4 normal = texelFetch(normals, texel, 0);
  vec3 point = texelFetch(points, texel, 0).xyz;
  vec4 low_point = texelFetch(low_points, texel, 0);
  vec3 offset = point - low_point.xyz;
  vec3 label = texelFetch(labels, texel, 0).xyz;
  vec3 value = vec3(0.0);
  bool is_on_low = low_point.a > 0.0;
  bool is_known = normal.a > 0.0;
  if (map_index == INDEX_POSITION) {
    value = mat3(to_space) * point + origin.xyz;
  }
  else if (map_index == INDEX_GRADIENT) {
    value = clamp(mat3(to_space) * point + origin.xyz, 0.0, 1.0);
  }
  else if (map_index == INDEX_HEIGHT) {
    value = vec3(dot(offset, texelFetch(directions, texel, 0).xyz) * scale);
    is_known = is_known && is_on_low;
  }
  else if (map_index == INDEX_DISPLACEMENT) {
    value = mat3(to_space) * offset;
    is_known = is_known && is_on_low;
  }
  else if (map_index == INDEX_DISTANCE) {
    value = vec3(length(offset) * scale);
    is_known = is_known && is_on_low;
  }
  else if (map_index == INDEX_COVERAGE) {
    value = vec3(is_known ? 1.0 : 0.0);
    is_known = true;  // 0 is a known value too
  }
  else {
    value = vec3(map_index == INDEX_OBJECT_ID ? label.x : map_index == INDEX_MATERIAL_ID ? label.y : label.z);
  }
  value_out = is_known ? vec4(value, 1.0) : vec4(0.0, 0.0, 0.0, min(normal.a, 0.0));
}
