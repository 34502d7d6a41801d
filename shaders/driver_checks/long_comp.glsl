// Takes as long as it is told: steps of a sequence of whole numbers, which are known without taking them. Writes them as floats and
// as whole numbers.

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(texel, imageSize(values)))) {
    return;
  }
  uint number = uint(first + texel.y * imageSize(values).x + texel.x);
  for (int turn = 0; turn < turns; turn++) {
    number = number * 1664525u + 1013904223u;
  }
  // Floats hold 24 bits.
  imageStore(values, texel, vec4(float(number >> 8u), float(number & 255u), 1.0, -1.0));
  imageStore(numbers, texel, uvec4(number, ~number, 7u, 4294967295u));
}
