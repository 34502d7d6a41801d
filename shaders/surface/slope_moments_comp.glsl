// Adds one sample of each texel to the second moments of the normals, which are stretched to a height of 1 above the low
// surface. An area of the low surface counts by its size then, however steep the detail on it is.

// Normals that lean farther than about 84 degrees count as if they leaned so far: their slopes have no limit.
const float LEAST_HEIGHT = 0.1;

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, first_row);
  if (any(greaterThanEqual(texel, texel_size(normals)))) {
    return;
  }
  vec4 normal = texel_at(normals, texel);
  if (normal.a <= 0.0 && is_first == 0) {
    return;
  }
  vec4 square = is_first != 0 ? vec4(0.0) : imageLoad(squares, texel);
  vec4 product = is_first != 0 ? vec4(0.0) : imageLoad(products, texel);
  if (normal.a > 0.0) {
    vec4 direction = has_directions != 0 ? texel_at(directions, texel) : vec4(0.0, 0.0, 1.0, 1.0);
    // A sample of the high surface may lie beside the low one.
    float height = direction.a > 0.0 ? dot(normal.xyz, direction.xyz) : 1.0;
    vec3 stretched = normal.xyz / max(height, LEAST_HEIGHT);
    square += vec4(stretched * stretched, 1.0);
    product += vec4(stretched * stretched.yzx, 0.0);
  }
  imageStore(squares, texel, square);
  imageStore(products, texel, product);
}
