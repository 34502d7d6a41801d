// A hit of a ray, as cast_comp.glsl writes it: x has the triangle's number + 1, or 0 for a miss, and flags; y and z have
// two barycentric coordinates, w the height above the low surface, along the ray.

// No triangle of the low mesh that belongs to the texel is the closest one to the hit.
const uint HIT_NOT_OWNED = 1u << 28;
// The ray hit the back of a triangle, since it hit no front.
const uint HIT_FROM_BEHIND = 1u << 29;
// The search has not ended: no map shows this one.
const uint HIT_UNFINISHED = 1u << 30;
const uint HIT_TRIANGLE = (1u << 28) - 1u;

bool hit_missed(uvec4 hit)
{
  return hit.x == 0u;
}

int hit_triangle(uvec4 hit)
{
  return int(hit.x & HIT_TRIANGLE) - 1;
}

vec2 hit_weights(uvec4 hit)
{
  return vec2(uintBitsToFloat(hit.y), uintBitsToFloat(hit.z));
}
