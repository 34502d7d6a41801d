// Encodes the first two channels of unit normals as a block of BC5, so that the normals come back at the least angle: readers
// make the third component from both. A lane for each block.
//
// To second order, the square of the angle of a texel is dx^2 + dy^2 + (x dx + y dy)^2 / z^2. With y as it is, this is a parabola
// of x: its lowest point and its steepness are the value and the weight with which x is searched. The channels take turns.
// Then each texel takes the pair of indices whose normal is nearest.
#include "lib/bc4_read_lib.glsl"

const int TURNS = 2;
const int MOST_WEIGHT = 1023;
const int MIDDLE = BC4_ONE / 2;
const int FARTHEST = 32767;  // so that three squares fit in 32 bits
const int UNIT = BC4_ONE / 64;  // the length of a normal where the parabolas are made
const int LEAST_SQUARE = UNIT * UNIT / 64;  // of z: near 0, the second order is no measure

// The largest whole number whose square is not above `number`, which is below 2^31.
int root(int number)
{
  int found = int(sqrt(float(number)));
  found -= int(found * found > number);
  found += int((found + 1) * (found + 1) <= number);
  return found;
}

// A quotient that is cut toward 0: GLSL leaves open how negative numbers are divided.
int quotient(int number, int by)
{
  return number < 0 ? -(-number / by) : number / by;
}

// A component of the normal that is searched: its own where z is at least 0. Below, no pair of channels says it, and the nearest
// normals are on the rim.
int on_top(int value, int other, int z)
{
  ivec2 place = ivec2(value, other) - MIDDLE;
  return z < MIDDLE ? MIDDLE + quotient(place.x * MIDDLE, max(root(place.x * place.x + place.y * place.y), 1)) : value;
}

ivec4 on_top_row(ivec4 values, ivec4 others, ivec4 z)
{
  ivec4 row = ivec4(0);
  for (int i = 0; i < 4; i++) {
    row[i] = on_top(values[i], others[i], z[i]);
  }
  return row;
}

Bc4Rows on_top_rows(Bc4Rows values, Bc4Rows others, Bc4Rows z)
{
  Bc4Rows rows;
  rows.a = on_top_row(values.a, others.a, z.a);
  rows.b = on_top_row(values.b, others.b, z.b);
  rows.c = on_top_row(values.c, others.c, z.c);
  rows.d = on_top_row(values.d, others.d, z.d);
  return rows;
}

// The value that a component is searched with, and its weight, where the other one is off by `off`.
ivec2 aim(int value, int other, int off, int weight)
{
  ivec2 place = (ivec2(value, other) - MIDDLE) >> 5;
  int rest = max(UNIT * UNIT - place.x * place.x - place.y * place.y, LEAST_SQUARE);
  int steepness = rest + place.x * place.x;
  int slope = quotient(place.x * place.y * 256, steepness);
  return ivec2(value - ((slope * off) >> 8), min(steepness * 16 / rest * weight / 16, MOST_WEIGHT));
}

struct Aims {
  Bc4Rows values;
  Bc4Rows weights;
};

Aims aims(Bc4Rows values, Bc4Rows others, Bc4Rows read, Bc4Rows weights)
{
  Aims found;
  for (int i = 0; i < 4; i++) {
    ivec2 a = aim(values.a[i], others.a[i], read.a[i] - others.a[i], weights.a[i]);
    ivec2 b = aim(values.b[i], others.b[i], read.b[i] - others.b[i], weights.b[i]);
    ivec2 c = aim(values.c[i], others.c[i], read.c[i] - others.c[i], weights.c[i]);
    ivec2 d = aim(values.d[i], others.d[i], read.d[i] - others.d[i], weights.d[i]);
    found.values.a[i] = a.x;
    found.values.b[i] = b.x;
    found.values.c[i] = c.x;
    found.values.d[i] = d.x;
    found.weights.a[i] = a.y;
    found.weights.b[i] = b.y;
    found.weights.c[i] = c.y;
    found.weights.d[i] = d.y;
  }
  return found;
}

// Takes a pair of indices for those of four texels whose normals are nearer to what it shows than to what they had.
// Components are from 0 to BC4_ONE.
void take_nearer(int pair, ivec3 shown, ivec4 x, ivec4 y, ivec4 z, inout ivec4 found, inout uvec4 least)
{
  uvec4 x_off = uvec4(min(abs(x - shown.x), ivec4(FARTHEST)));
  uvec4 y_off = uvec4(min(abs(y - shown.y), ivec4(FARTHEST)));
  uvec4 z_off = uvec4(min(abs(z - shown.z), ivec4(FARTHEST)));
  uvec4 squares = x_off * x_off + y_off * y_off + z_off * z_off;
  found += ivec4(lessThan(squares, least)) * (pair - found);
  least = min(least, squares);
}

void main()
{
  ivec2 block = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(block, imageSize(blocks)))) {
    return;
  }
  ivec2 start = block * 4;
  Bc4Rows counts = bc4_read_weights(start);
  Bc4Rows x = bc4_read_channel(start, 0);
  Bc4Rows y = bc4_read_channel(start, 1);
  Bc4Rows z = bc4_read_channel(start, 2);
  Bc4Rows x_top = on_top_rows(x, y, z);
  Bc4Rows y_top = on_top_rows(y, x, z);
  Bc4Rows y_read = y_top;
  ivec3 x_ends = ivec3(0);
  ivec3 y_ends = ivec3(0);
  for (int turn = 0; turn < TURNS; turn++) {
    Aims aimed = aims(x_top, y_top, y_read, counts);
    x_ends = bc4_search(aimed.values, aimed.weights);
    Bc4Rows x_read = bc4_values(bc4_indices(aimed.values, x_ends), x_ends);
    aimed = aims(y_top, x_top, x_read, counts);
    y_ends = bc4_search(aimed.values, aimed.weights);
    y_read = bc4_values(bc4_indices(aimed.values, y_ends), y_ends);
  }
  // A pair is the index of x, and 8 times that of y.
  Bc4Rows both;
  both.a = ivec4(0);
  both.b = ivec4(0);
  both.c = ivec4(0);
  both.d = ivec4(0);
  uvec4 least_a = uvec4(BC4_NONE);
  uvec4 least_b = uvec4(BC4_NONE);
  uvec4 least_c = uvec4(BC4_NONE);
  uvec4 least_d = uvec4(BC4_NONE);
  for (int pair = 0; pair < 64; pair++) {
    ivec3 shown = ivec3(bc4_value(x_ends, pair & 7), bc4_value(y_ends, pair >> 3), MIDDLE);
    ivec2 place = shown.xy - MIDDLE;
    int rest = MIDDLE * MIDDLE - place.x * place.x;
    shown.z += rest > place.y * place.y ? root(rest - place.y * place.y) : 0;
    take_nearer(pair, shown, x.a, y.a, z.a, both.a, least_a);
    take_nearer(pair, shown, x.b, y.b, z.b, both.b, least_b);
    take_nearer(pair, shown, x.c, y.c, z.c, both.c, least_c);
    take_nearer(pair, shown, x.d, y.d, z.d, both.d, least_d);
  }
  Bc4Rows of_x;
  of_x.a = both.a & 7;
  of_x.b = both.b & 7;
  of_x.c = both.c & 7;
  of_x.d = both.d & 7;
  Bc4Rows of_y;
  of_y.a = both.a >> 3;
  of_y.b = both.b >> 3;
  of_y.c = both.c >> 3;
  of_y.d = both.d >> 3;
  imageStore(blocks, block, uvec4(bc4_packed(x_ends, of_x), bc4_packed(y_ends, of_y)));
}
