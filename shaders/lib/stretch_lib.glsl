// Of a mesh with other scales along its axes. to_basis: from object space to the space of its normals and tangents.
#define in_basis_space(v) (mat3(to_basis) * (v))
