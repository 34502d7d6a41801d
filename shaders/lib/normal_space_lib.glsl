// Normals between world space and that of a map. to_space, a MAT4, transforms normals from world space; they are not normalized.

// `vector` with length 1, or zero if it has no length.
vec3 normal_space_unit(vec3 vector)
{
  float length_squared = dot(vector, vector);
  return length_squared > 0.0 ? vector / sqrt(length_squared) : vec3(0.0);
}

vec3 normal_space_from_world(vec3 normal)
{
  return normal_space_unit(mat3(to_space) * normal);
}

// The inverse. Only directions matter, so that of the determinant only the sign counts.
vec3 normal_space_to_world(vec3 normal)
{
  vec3 x = to_space[0].xyz;
  vec3 y = to_space[1].xyz;
  vec3 z = to_space[2].xyz;
  vec3 turned = vec3(dot(cross(y, z), normal), dot(cross(z, x), normal), dot(cross(x, y), normal));
  return normal_space_unit(turned * sign(dot(cross(x, y), z)));
}
