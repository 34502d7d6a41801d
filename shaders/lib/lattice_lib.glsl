// The points of a lattice in the unit square, shifted differently for each texel, and directions from them.
// passes/hemisphere/lattice.py chooses the lattice.

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
// effectiveness of quasirandom sequences", 2018) along a Hilbert curve. `cell` has the two shortest vectors of the lattice.
// Shifts stay in this cell, so that ray number k goes about the same way from all texels, and lanes take similar paths.
vec2 lattice_shift(ivec2 texel, vec4 cell)
{
  vec2 share = fract(0.5 + float(lattice_place(texel)) * vec2(0.7548776662, 0.5698402910));
  return share.x * cell.xy + share.y * cell.zw;
}

// Point number i. `steps` has the numerators of the step from a point to the next, and their denominator: the number of points.
vec2 lattice_point(int i, vec3 steps, vec2 shift)
{
  return fract(mod(float(i) * steps.xy, steps.z) / steps.z + shift);
}

// A direction around the unit vector `axis`, at the angle with this cosine.
vec3 lattice_direction(float cosine, float turn, vec3 axis)
{
  // T. Duff and others, "Building an orthonormal basis, revisited" (2017).
  float side = axis.z < 0.0 ? -1.0 : 1.0;
  float a = -1.0 / (side + axis.z);
  float b = axis.x * axis.y * a;
  vec3 right = vec3(1.0 + side * axis.x * axis.x * a, side * b, -side * axis.x);
  vec3 up = vec3(b, side + axis.y * axis.y * a, -axis.y);
  float sine = sqrt(max(1.0 - cosine * cosine, 0.0));
  float angle = 6.283185307 * turn;
  return right * (sine * cos(angle)) + up * (sine * sin(angle)) + axis * cosine;
}
