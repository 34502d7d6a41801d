// Tangent space as MikkTSpace defines it: tangent, bitangent = sign * cross(normal, tangent), normal. After interpolation
// across a triangle, the three vectors may have any length, and need not be perpendicular.

// The components of `vector` in that basis: solves x * tangent + y * bitangent + z * normal = vector.
// A basis without volume gives components that are not finite.
vec3 basis_components(vec3 vector, vec3 tangent, float sign, vec3 normal)
{
  vec3 bitangent = sign * cross(normal, tangent);
  // Cramer's rule. The bitangent is perpendicular to the other two, so that its component is a projection.
  float volume = dot(bitangent, bitangent);
  float nn = dot(normal, normal);
  float tt = dot(tangent, tangent);
  float tn = dot(tangent, normal);
  float vt = dot(vector, tangent);
  float vn = dot(vector, normal);
  return vec3(nn * vt - tn * vn, dot(vector, bitangent), tt * vn - tn * vt) / volume;
}

// The inverse: the vector with these components.
vec3 basis_vector(vec3 components, vec3 tangent, float sign, vec3 normal)
{
  return components.x * tangent + components.y * sign * cross(normal, tangent) + components.z * normal;
}
