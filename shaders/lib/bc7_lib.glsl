// The texels of a block as whole numbers, for the format BC7. Each driver has the same bits, since nothing is rounded.

// Quarters of a step of 8 bits.
const int BC7_ONE = 1020;
const int BC7_MOST = 2147483647;
// How much a texel of weight 1 counts.
const int BC7_HEAVIEST = 15;

// A color in quarters of steps, rounded. The product is cut to a whole number at once, so that no compiler merges it with a sum.
ivec4 bc7_fixed(vec4 color)
{
  return (ivec4(clamp(color, vec4(0.0), vec4(1.0)) * 2040.0) + 1) >> 1;
}

// How much a texel of this weight counts: 1 at least, if at all.
int bc7_weight(float weight)
{
  return weight > 0.0 ? max((int(min(weight, 1.0) * 30.0) + 1) >> 1, 1) : 0;
}

// The square of the slope of the curve of sRGB, about, in 1/4096; for channels that are not curved, 4096.
ivec4 bc7_slopes(ivec4 color, ivec4 is_curved)
{
  ivec4 slope = 13 + ((color * 1397) >> 10) + ((((color * 938) >> 10) * color) >> 10);
  slope = max(slope, ivec4(79));
  slope += (1024 - slope) * (1 - is_curved);
  return (slope * slope) >> 8;
}

// Linear values of colors, about, in 24 bits: 0.305 x^3 + 0.682 x^2 + 0.013 x, which is within 0.2 % of sRGB.
ivec4 bc7_linear(ivec4 color)
{
  return color * (208 + ((color * (11184 + ((color * 5008) >> 10))) >> 10));
}

// What errors are differences of, in 24 bits.
ivec4 bc7_seen(ivec4 color, ivec4 is_curved)
{
  ivec4 straight = color << 14;
  return straight + (bc7_linear(color) - straight) * is_curved;
}

int bc7_sum(ivec4 a)
{
  return a.x + a.y + a.z + a.w;
}

int bc7_dot(ivec4 a, ivec4 b)
{
  return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
}

int bc7_largest(ivec4 a)
{
  return max(max(a.x, a.y), max(a.z, a.w));
}

// How many bits a number from 0 on has.
int bc7_length(int number)
{
  int length = 0;
  for (int step_bits = 16; step_bits > 0; step_bits >>= 1) {
    if (number >> step_bits > 0) {
      number >>= step_bits;
      length += step_bits;
    }
  }
  return length + (number > 0 ? 1 : 0);
}

// A quotient, rounded toward 0 also where the dividend is below 0.
int bc7_quotient(int dividend, int divisor)
{
  int whole = (abs(dividend) + (divisor >> 1)) / divisor;
  return dividend < 0 ? -whole : whole;
}
ivec4 bc7_quotients(ivec4 dividend, ivec4 divisor)
{
  return ivec4(bc7_quotient(dividend.x, divisor.x), bc7_quotient(dividend.y, divisor.y),
               bc7_quotient(dividend.z, divisor.z), bc7_quotient(dividend.w, divisor.w));
}

// The scatter of texels about their mean: a symmetric matrix.
struct Bc7Scatter {
  ivec4 diagonal;
  ivec4 beside;  // xy, xz, xw, yz
  ivec2 last;    // yw, zw
};

// The scatter times a direction.
ivec4 bc7_times(Bc7Scatter m, ivec4 v)
{
  return ivec4(m.diagonal.x * v.x + m.beside.x * v.y + m.beside.y * v.z + m.beside.z * v.w,
               m.beside.x * v.x + m.diagonal.y * v.y + m.beside.w * v.z + m.last.x * v.w,
               m.beside.y * v.x + m.beside.w * v.y + m.diagonal.z * v.z + m.last.y * v.w,
               m.beside.z * v.x + m.last.x * v.y + m.last.y * v.z + m.diagonal.w * v.w);
}

// The principal direction by the power method, from the column of the largest diagonal on. Its largest component has as many
// bits. The entries of the matrix have at most 14 bits and a sign.
ivec4 bc7_direction(Bc7Scatter m, int bits)
{
  int largest = bc7_largest(m.diagonal);
  ivec4 start = ivec4(0);
  start[3] = 1;
  if (m.diagonal.z == largest) { start = ivec4(0, 0, 1, 0); }
  if (m.diagonal.y == largest) { start = ivec4(0, 1, 0, 0); }
  if (m.diagonal.x == largest) { start = ivec4(1, 0, 0, 0); }
  ivec4 direction = bc7_times(m, start);
  for (int i = 0; i < 5; i++) {
    int excess = bc7_length(bc7_largest(abs(direction))) - bits;
    direction = excess > 0 ? direction >> excess : direction << -excess;
    if (i < 4) {
      direction = bc7_times(m, direction);
    }
  }
  return direction;
}
