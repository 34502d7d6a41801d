// Tangent space as MikkTSpace defines it: tangent, bitangent = sign * cross(normal, tangent), normal. None of the three
// need be of length one or at right angles once they were interpolated across a triangle.

// The components of `vector` in that basis: solves x * tangent + y * bitangent + z * normal = vector.
// A basis without volume gives components that are not finite.
vec3 basis_components(vec3 vector, vec3 tangent, float sign, vec3 normal)
{
  vec3 bitangent = sign * cross(normal, tangent);
  // Cramer's rule; the bitangent is at right angles to the other two, so that its component is a projection.
  float volume = dot(bitangent, bitangent);
  float nn = dot(normal, normal);
  float tt = dot(tangent, tangent);
  float tn = dot(tangent, normal);
  float vt = dot(vector, tangent);
  float vn = dot(vector, normal);
  return vec3(nn * vt - tn * vn, dot(vector, bitangent), tt * vn - tn * vt) / volume;
}

// The other way: the vector that has these components.
vec3 basis_vector(vec3 components, vec3 tangent, float sign, vec3 normal)
{
  return components.x * tangent + components.y * sign * cross(normal, tangent) + components.z * normal;
}
