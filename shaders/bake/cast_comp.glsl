// Traces one ray per texel, from the cage of the low mesh to the first triangle of the high meshes. mesh/bvh.py builds the
// tree.
#include "lib/texture_lib.glsl"

// Neighboring triangles overlap by this much, in barycentric coordinates, so that no ray passes between them: a constant,
// plus the error of single precision, which grows where the triangle is small and far from the start of the ray.
const float CAST_EDGE = 1e-5;
const float CAST_ROUNDING = 4e-7;
const float CAST_MOST = 1e-3;

// Unpack the two numbers of 15 bits from the bits of a float (bvh.pack).
vec4 cast_low(uvec4 bits)
{
  return vec4(bits & 0x7fffu);
}

vec4 cast_high(uvec4 bits)
{
  return vec4(bits >> 15);
}

// The node to visit after the subtree of `node`: a sibling of the node or of an ancestor. `trail` holds four bits per level,
// deepest first: the siblings still to be visited. Returns -1 at the end.
int cast_next(int node, inout uvec2 trail)
{
  if (trail.x == 0u) {
    if (trail.y == 0u) {
      return -1;
    }
    trail = uvec2(trail.y, 0u);
    node = (node - 21845) >> 16;  // eight levels up: 21845 = (4^8 - 1) / 3
  }
  int levels = findLSB(trail.x) >> 2;
  int bits = levels * 4;
  if (levels > 0) {
    trail = uvec2((trail.x >> bits) | (trail.y << (32 - bits)), trail.y >> bits);
    node = (node - ((1 << (levels * 2)) - 1) / 3) >> (levels * 2);
  }
  int slot = findLSB(trail.x & 15u);
  trail.x &= trail.x - 1u;
  return ((node - 1) & ~3) + 1 + slot;
}

void main()
{
  // A workgroup is a square, and eight consecutive lanes are a block of 4 x 2: rays of close texels take similar paths.
  int lane = int(gl_LocalInvocationIndex);
  ivec2 inner = ivec2((lane & 3) | ((lane >> 1) & 4), ((lane >> 2) & 1) | ((lane >> 3) & 6));
  ivec2 texel = ivec2(gl_WorkGroupID.xy) * 8 + inner + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, texel_size(positions)))) {
    return;
  }
  vec4 start = texel_at(positions, texel);
  uvec4 hit = uvec4(0u);
  if (start.a > 0.0) {
    vec3 direction = texel_at(directions, texel).xyz * direction_sign;
    vec3 origin = start.xyz - direction * start_offset;
    float best = max_t;

    // In grid steps, boxes have integer coordinates. A zero component would give 0 * infinity for a ray inside a slab.
    vec3 grid_start = (origin - grid_origin.xyz) * grid_scale.xyz;
    vec3 grid_direction = direction * grid_scale.xyz;
    grid_direction = mix(grid_direction, vec3(1e-12), lessThan(abs(grid_direction), vec3(1e-12)));
    vec3 inverse = 1.0 / grid_direction;
    bvec3 forward = greaterThan(inverse, vec3(0.0));
    uvec2 trail = uvec2(0u);
    int node = 0;
    while (node >= 0) {
      uint triangles = 0u;
      int first = 0;
      // Walk the tree until the ray hits a node of triangles. Triangles are tested outside this loop: inside it, lanes that
      // have found triangles would wait for the others at every step.
      while (node >= 0 && triangles == 0u) {
        uvec4 x = floatBitsToUint(texel_at(nodes, texture_place(node * 3)));
        uvec4 y = floatBitsToUint(texel_at(nodes, texture_place(node * 3 + 1)));
        uvec4 z = floatBitsToUint(texel_at(nodes, texture_place(node * 3 + 2)));
        vec4 x_low = (cast_low(x) - grid_start.x) * inverse.x;
        vec4 y_low = (cast_low(y) - grid_start.y) * inverse.y;
        vec4 z_low = (cast_low(z) - grid_start.z) * inverse.z;
        vec4 x_high = (cast_high(x) - grid_start.x) * inverse.x;
        vec4 y_high = (cast_high(y) - grid_start.y) * inverse.y;
        vec4 z_high = (cast_high(z) - grid_start.z) * inverse.z;
        // Select by the ray's direction instead of min and max: then the ray leaves a missing box before it enters it.
        vec4 enter = max(max(forward.x ? x_low : x_high, forward.y ? y_low : y_high),
                         max(forward.z ? z_low : z_high, vec4(0.0)));
        vec4 leave = min(min(forward.x ? x_high : x_low, forward.y ? y_high : y_low),
                         min(forward.z ? z_high : z_low, vec4(best)));
        bvec4 boxes = lessThanEqual(enter, leave);
        uint mask = (boxes.x ? 1u : 0u) | (boxes.y ? 2u : 0u) | (boxes.z ? 4u : 0u) | (boxes.w ? 8u : 0u);
        int child = node * 4 + 1;
        if (mask != 0u && child < first_leaf) {
          int slot = findLSB(mask);
          trail = uvec2((trail.x << 4) | (mask & (mask - 1u)), (trail.y << 4) | (trail.x >> 28));
          node = child + slot;
        }
        else {
          triangles = mask;
          first = child - first_leaf;
          node = cast_next(node, trail);
        }
      }
      while (triangles != 0u) {
        int triangle = first + findLSB(triangles);
        triangles &= triangles - 1u;
        vec3 corner = texel_at(corners, texture_place(triangle * 3)).xyz;
        vec3 edge1 = texel_at(corners, texture_place(triangle * 3 + 1)).xyz - corner;
        vec3 edge2 = texel_at(corners, texture_place(triangle * 3 + 2)).xyz - corner;
        // T. Möller and B. Trumbore, "Fast, minimum storage ray/triangle intersection" (1997).
        vec3 p = cross(direction, edge2);
        float determinant = dot(edge1, p);
        vec3 to_origin = origin - corner;
        vec3 q = cross(to_origin, edge1);
        vec3 solved = vec3(dot(to_origin, p), dot(direction, q), dot(edge2, q)) / determinant;
        float lever = sqrt(dot(to_origin, to_origin) * max(dot(edge1, edge1), dot(edge2, edge2)));
        float slack = CAST_EDGE + min(CAST_ROUNDING * lever / abs(determinant), CAST_MOST);
        bool inside = solved.x >= -slack && solved.y >= -slack && solved.x + solved.y <= 1.0 + slack;
        bool faces = determinant > 0.0 || facing_only == 0;
        if (inside && faces && solved.z >= 0.0 && solved.z < best) {
          best = solved.z;
          hit = uvec4(uint(triangle) + 1u, floatBitsToUint(solved.x), floatBitsToUint(solved.y), floatBitsToUint(best));
        }
      }
    }
  }
  imageStore(hits, texel, hit);
}
