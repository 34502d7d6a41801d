// The points of a lattice in the unit square, shifted differently for each texel, and directions from them.
// passes/hemisphere.py chooses the lattice.

const int LATTICE_SIDE = 64;  // the shifts repeat after as many texels

// The place of a texel on a Hilbert curve through a square of LATTICE_SIDE x LATTICE_SIDE texels.
int lattice_place(ivec2 texel)
{
  ivec2 at = texel & (LATTICE_SIDE - 1);
  int place = 0;
  for (int side = LATTICE_SIDE / 2; side > 0; side /= 2) {
    ivec2 quarter = ivec2((at.x & side) != 0 ? 1 : 0, (at.y & side) != 0 ? 1 : 0);
    place += side * side * ((3 * quarter.x) ^ quarter.y);
    if (quarter.y == 0) {
      at = quarter.x == 1 ? ivec2(LATTICE_SIDE - 1) - at.yx : at.yx;
    }
  }
  return place;
}

// The shift of a texel's lattice. Close texels get shifts that are far apart: the R2 sequence (M. Roberts, "The unreasonable
// effectiveness of quasirandom sequences", 2018) along a Hilbert curve. `shortest` has the two shortest vectors of the
// lattice. Shifts stay in the cell between them, so that ray number k goes about the same way from all texels, and lanes take
// similar paths.
vec2 lattice_shift(ivec2 texel, vec4 shortest)
{
  vec2 share = fract(0.5 + float(lattice_place(texel)) * vec2(0.7548776662, 0.5698402910));
  return share.x * shortest.xy + share.y * shortest.zw;
}

// The points first, first + stride, first + 2 * stride and first + 3 * stride. `fractions` has the numerators of the step
// from a point to the next, and their denominator: the number of points.
void lattice_points(int first, int stride, vec3 fractions, vec2 shift, out vec4 u, out vec4 v)
{
  vec4 numbers_of_points = float(first) + float(stride) * vec4(0.0, 1.0, 2.0, 3.0);
  u = fract(mod(numbers_of_points * fractions.x, fractions.z) / fractions.z + shift.x);
  v = fract(mod(numbers_of_points * fractions.y, fractions.z) / fractions.z + shift.y);
}

// Four directions around the unit vector `axis`: the coordinates x, y and z. `cosine` is that of the angle to the axis, and
// `turn` the share of a full turn around it.
void lattice_directions(vec4 cosine, vec4 turn, vec3 axis, out vec4 x, out vec4 y, out vec4 z)
{
  // T. Duff and others, "Building an orthonormal basis, revisited" (2017).
  float side = axis.z < 0.0 ? -1.0 : 1.0;
  float a = -1.0 / (side + axis.z);
  float b = axis.x * axis.y * a;
  vec3 right = vec3(1.0 + side * axis.x * axis.x * a, side * b, -side * axis.x);
  vec3 up = vec3(b, side + axis.y * axis.y * a, -axis.y);
  vec4 sine = sqrt(max(1.0 - cosine * cosine, 0.0));
  vec4 along_right = sine * cos(6.283185307 * turn);
  vec4 along_up = sine * sin(6.283185307 * turn);
  x = right.x * along_right + up.x * along_up + axis.x * cosine;
  y = right.y * along_right + up.y * along_up + axis.y * cosine;
  z = right.z * along_right + up.z * along_up + axis.z * cosine;
}

// Which of four rays exist, as 0 or 1, if `left` rays are left.
vec4 lattice_exists(int left)
{
  return vec4(lessThan(vec4(0.0, 1.0, 2.0, 3.0), vec4(float(left))));
}
