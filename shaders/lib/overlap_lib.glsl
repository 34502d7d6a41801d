// Neighboring triangles overlap a little, so that no ray passes between them: by a constant, plus the error of single precision,
// which grows where the triangle is small and far from the start of the ray.
const float OVERLAP_EDGE = 1e-5;
const float OVERLAP_ROUNDING = 4e-7;
const float OVERLAP_MOST = 1e-3;
// Rays pass triangles with a smaller determinant: those without area, and those seen exactly from the side.
const float OVERLAP_FLAT = 1e-30;

// How far outside a triangle a ray still hits it, in barycentric coordinates. lever: the distance from the triangle's first
// corner to the start of the ray, times the length of the longer edge at that corner.
float overlap_slack(float lever, float determinant)
{
  return OVERLAP_EDGE + min(OVERLAP_ROUNDING * lever / abs(determinant), OVERLAP_MOST);
}
