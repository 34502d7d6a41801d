// Closest points. Triangles and segments may be degenerate.

vec3 closest_on_segment(vec3 point, vec3 start, vec3 end)
{
  vec3 along = end - start;
  float length_squared = dot(along, along);
  float share = length_squared > 0.0 ? clamp(dot(point - start, along) / length_squared, 0.0, 1.0) : 0.0;
  return start + along * share;
}

vec3 closest_nearer(vec3 point, vec3 a, vec3 b)
{
  vec3 to_a = a - point, to_b = b - point;
  return dot(to_b, to_b) < dot(to_a, to_a) ? b : a;
}

// `normal`: cross(b - a, c - a).
vec3 closest_on_triangle(vec3 point, vec3 a, vec3 b, vec3 c, vec3 normal)
{
  float area = dot(normal, normal);
  bool above = dot(cross(normal, b - a), point - a) >= 0.0 && dot(cross(normal, c - b), point - b) >= 0.0 &&
               dot(cross(normal, a - c), point - c) >= 0.0;
  if (above && area > 0.0) {
    return point - normal * (dot(normal, point - a) / area);
  }
  vec3 nearest = closest_nearer(point, closest_on_segment(point, a, b), closest_on_segment(point, b, c));
  return closest_nearer(point, nearest, closest_on_segment(point, c, a));
}
