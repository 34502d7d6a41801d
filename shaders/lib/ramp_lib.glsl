// Colors for small to large values, gray for unknown ones, and purple for values of another place.

const vec3 RAMP_UNKNOWN = vec3(0.1);
const vec3 RAMP_ELSEWHERE = vec3(0.45, 0.0, 0.6);

vec3 ramp_color(float share)
{
  vec3 low = vec3(0.0, 0.01, 0.15), green = vec3(0.0, 0.35, 0.1), yellow = vec3(0.9, 0.75, 0.0), red = vec3(0.7, 0.0, 0.0);
  float x = clamp(share, 0.0, 1.0) * 3.0;
  return mix(mix(mix(low, green, clamp(x, 0.0, 1.0)), yellow, clamp(x - 1.0, 0.0, 1.0)), red, clamp(x - 2.0, 0.0, 1.0));
}
