// Takes as long as it is told: steps of a sequence of whole numbers, which are known without taking them, eight in each turn of a
// loop. Writes them as floats and as whole numbers.

// As SIDE in passes/driver_checks.py: the numbers of rows are this far apart, however many columns there are.
const int LONG_SIDE = 64;

uint long_step(uint number)
{
  return number * 1664525u + 1013904223u;
}

void main()
{
  ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(texel, imageSize(values)))) {
    return;
  }
  uint number = uint(first + texel.y * LONG_SIDE + texel.x);
  for (int turn = 0; turn < turns; turn++) {
    number = long_step(long_step(long_step(long_step(number))));
    number = long_step(long_step(long_step(long_step(number))));
  }
  // Floats hold 24 bits.
  imageStore(values, texel, vec4(float(number >> 8u), float(number & 255u), 1.0, -1.0));
  imageStore(numbers, texel, uvec4(number, ~number, 7u, 4294967295u));
}
