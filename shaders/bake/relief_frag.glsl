// One of the maps beside the normal map: what lies between the low surface and the high one. `which` is as in surface_values.py.

void main()
{
  ivec2 texel = ivec2(gl_FragCoord.xy);
  vec4 normal = texelFetch(normals, texel, 0);
  vec3 point = texelFetch(points, texel, 0).xyz;
  vec4 place = texelFetch(places, texel, 0);
  vec3 apart = point - place.xyz;
  vec2 label = texelFetch(labels, texel, 0).xy;
  vec3 value = vec3(0.0);
  bool is_on_low = place.a > 0.0;
  bool is_known = normal.a > 0.0;
  if (which == 0) {
    value = mat3(to_space) * point + origin.xyz;
  }
  else if (which == 1) {
    value = vec3(dot(apart, texelFetch(directions, texel, 0).xyz) * scale);
    is_known = is_known && is_on_low;
  }
  else if (which == 2) {
    value = mat3(to_space) * apart;
    is_known = is_known && is_on_low;
  }
  else if (which == 3) {
    value = vec3(length(apart) * scale);
    is_known = is_known && is_on_low;
  }
  else if (which == 4) {
    value = vec3(is_known ? 1.0 : 0.0);
    is_known = true;  // that nothing is there is known as well
  }
  else {
    value = vec3(which == 5 ? label.x : label.y);
  }
  value_out = is_known ? vec4(value, 1.0) : vec4(0.0, 0.0, 0.0, min(normal.a, 0.0));
}
