// Tangent space as MikkTSpace defines it: tangent, bitangent = sign * cross(normal, tangent), normal. After interpolation
// across a triangle, the three vectors may have any length, and need not be perpendicular. Programs differ in what they do
// with them then: `flags` hold the rules of core.declarations.bases.

const int BASIS_BITANGENT_OF_VERTICES = 1;
const int BASIS_NORMALIZES_TANGENT = 2;
const int BASIS_NORMALIZES_BITANGENT = 4;
const int BASIS_NORMALIZES_NORMAL = 8;

// `tangent`: with the sign in w.
vec3 basis_bitangent(vec3 normal, vec4 tangent)
{
  return tangent.w * cross(normal, tangent.xyz);
}

vec3 basis_unit(vec3 vector)
{
  return vector / max(length(vector), 1e-20);
}

// Tangent, bitangent and normal of a pixel, as columns, from those of the vertices after interpolation.
mat3 basis_of(int flags, vec3 normal, vec4 tangent, vec3 bitangent)
{
  vec3 n = (flags & BASIS_NORMALIZES_NORMAL) != 0 ? basis_unit(normal) : normal;
  vec3 t = (flags & BASIS_NORMALIZES_TANGENT) != 0 ? basis_unit(tangent.xyz) : tangent.xyz;
  vec3 b = (flags & BASIS_BITANGENT_OF_VERTICES) != 0 ? bitangent : basis_bitangent(n, vec4(t, tangent.w));
  return mat3(t, (flags & BASIS_NORMALIZES_BITANGENT) != 0 ? basis_unit(b) : b, n);
}

// A basis with less volume has none.
const float BASIS_LEAST_VOLUME = 1e-30;

// The components of `vector`: solves basis * components = vector by Cramer's rule. Zero for a basis without volume.
vec3 basis_components(vec3 vector, mat3 basis)
{
  vec3 across = cross(basis[1], basis[2]);
  vec3 volumes = vec3(
      dot(vector, across), dot(vector, cross(basis[2], basis[0])), dot(vector, cross(basis[0], basis[1])));
  float volume = dot(basis[0], across);
  return abs(volume) > BASIS_LEAST_VOLUME ? volumes / volume : vec3(0.0);
}
