// Integrals over the part of a triangle that lies in the ball of radius 1 around the origin, with the weight (1 - r)^3 of Cycles'
// Bevel node, where r is the distance from the origin. In closed form: no samples, no noise.
//
// In the plane of the triangle, at the distance h, let q be the foot of the origin, and s the distance of a point from the origin.
// With M(s) = s^2 / 2 - s^3 + 3 s^4 / 4 - s^5 / 5 - 1 / 20, which is 0 where the ball ends, M'(s) = s (1 - s)^3. In polar coordinates
// around q, the integral of the weight is that of (M(s) - M(h)) over the angle, along the edges. By the theorem of Gauss, the
// integral of the weight times the way from q is that of M(s) times the outward normal, along the edges.

// An edge as seen from q: where it starts and stops along its own line, counted from the point closest to q, its distance from
// there, positive where q is inside, and the squares of the distances of that point and the plane from the origin.
struct BallEdge {
  float start, stop, away, c2, h2;
};

// Triangles whose two edges at the first corner are shorter, squared, are summed at the middles of their edges instead, which is
// quicker, and better than differences of single precision. A right angle in triangles of this size is off by 0.01 degrees.
const float BALL_SMALL = 0.01;

float ball_potential(float s)
{
  return s * s * (0.5 + s * (-1.0 + s * (0.75 - 0.2 * s))) - 0.05;
}

// The antiderivatives, at `t` along the edge, of M(s), in x, and in y of the part of M(s) / (away^2 + t^2) that is no angle.
vec2 ball_antiderivatives(BallEdge edge, float t)
{
  float c2 = edge.c2, h2 = edge.h2;
  float t2 = t * t;
  float s2 = c2 + t2;
  float s = sqrt(s2);
  float root = sign(t) * log(max(abs(t) + s, 1e-30) / max(sqrt(c2), 1e-30));
  root = c2 > 0.0 ? root : 0.0;
  // Of s, s^3 and s^5.
  float s_1 = 0.5 * (t * s + c2 * root);
  float s_3 = 0.25 * t * s2 * s + 0.75 * c2 * s_1;
  float s_5 = (t * s2 * s2 * s + 5.0 * c2 * s_3) / 6.0;
  float whole = 0.5 * t * (c2 + t2 / 3.0) - s_3 + 0.75 * t * (c2 * c2 + t2 * (2.0 / 3.0 * c2 + 0.2 * t2)) - 0.2 * s_5 - 0.05 * t;
  float odd = s_1 + h2 * root;
  float around = 0.5 * t - odd + 0.75 * t * (c2 + h2 + t2 / 3.0) - 0.2 * (s_3 + h2 * odd);
  return vec2(whole, around);
}

// What an edge adds to the integral of M(s) along it, in x, and to that of the weight over the triangle, in y.
vec2 ball_of_edge(BallEdge edge)
{
  float side = edge.away < 0.0 ? -1.0 : 1.0;
  float away = max(abs(edge.away), 1e-20);
  float h = sqrt(edge.h2);
  float half_chord = sqrt(max(1.0 - edge.c2, 0.0));
  float start = clamp(edge.start, -half_chord, half_chord);
  float stop = clamp(edge.stop, -half_chord, half_chord);
  float whole_angle = atan(edge.stop, away) - atan(edge.start, away);
  float angle = atan(stop, away) - atan(start, away);
  vec2 inside = ball_antiderivatives(edge, stop) - ball_antiderivatives(edge, start);
  float turned = atan(h * stop, max(away * sqrt(edge.c2 + stop * stop), 1e-30)) -
                 atan(h * start, max(away * sqrt(edge.c2 + start * start), 1e-30));
  float h3 = edge.h2 * h;
  float angles = (h3 + 0.2 * h3 * edge.h2) * (angle - turned) - ball_potential(h) * (whole_angle - angle);
  return vec2(inside.x, side * (away * inside.y + angles));
}

// The weight times a point, in xyz, and the weight in w.
vec4 ball_at(vec3 point)
{
  float left = max(1.0 - length(point), 0.0);
  return vec4(point, 1.0) * (left * left * left);
}

// The integral of the weight, in w, and of the weight times the point, in xyz, over a triangle with these corners.
vec4 ball_moments(vec3 a, vec3 b, vec3 c)
{
  vec3 across = cross(b - a, c - a);
  float area = length(across);
  if (area <= 0.0) {
    return vec4(0.0);
  }
  vec3 face = across / area;
  float height = dot(face, a + b + c) / 3.0;
  if (abs(height) >= 1.0) {
    return vec4(0.0);
  }
  bool is_small = max(dot(b - a, b - a), dot(c - a, c - a)) < BALL_SMALL;
  vec4 sum = vec4(0.0);
  vec3 from = c;
  // No branch: software would run all of it.
  for (int corner = is_small ? 3 : 0; corner < 3; corner++) {
    vec3 to = corner == 0 ? a : corner == 1 ? b : c;
    vec3 way = to - from;
    float size = length(way);
    vec3 along = way / max(size, 1e-30);
    vec3 outward = cross(along, face);
    BallEdge edge;
    edge.away = dot(outward, from);
    edge.h2 = height * height;
    edge.c2 = edge.h2 + edge.away * edge.away;
    edge.start = dot(along, from);
    edge.stop = edge.start + size;
    vec2 found = ball_of_edge(edge);
    sum += vec4(outward * found.x, size > 0.0 ? found.y : 0.0);
    from = to;
  }
  if (is_small) {
    return (ball_at(0.5 * (a + b)) + ball_at(0.5 * (b + c)) + ball_at(0.5 * (c + a))) * (area / 6.0);
  }
  return vec4(sum.xyz + face * height * sum.w, sum.w);
}
