// Reads the texels of a block, and how much each counts.
#include "lib/bc4_lib.glsl"

// Whole numbers up to 16. What counts at all counts 1 at least.
int bc4_read_weight(float weight)
{
  return weight > 0.0 ? max(1, int(min(weight, 1.0) * 16.0 + 0.5)) : 0;
}

Bc4Rows bc4_read_weights(ivec2 start)
{
  Bc4Rows rows;
  rows.a = ivec4(16);
  rows.b = ivec4(16);
  rows.c = ivec4(16);
  rows.d = ivec4(16);
  if (has_weights != 0) {
    Bc4Rows given;
    for (int x = 0; x < 4; x++) {
      given.a[x] = bc4_read_weight(texel_at(weights, start + ivec2(x, 0)).x);
      given.b[x] = bc4_read_weight(texel_at(weights, start + ivec2(x, 1)).x);
      given.c[x] = bc4_read_weight(texel_at(weights, start + ivec2(x, 2)).x);
      given.d[x] = bc4_read_weight(texel_at(weights, start + ivec2(x, 3)).x);
    }
    // Of a block without texels that count, all do.
    if (any(greaterThan(max(max(given.a, given.b), max(given.c, given.d)), ivec4(0)))) {
      rows = given;
    }
  }
  return rows;
}

Bc4Rows bc4_read_channel(ivec2 start, int channel)
{
  Bc4Rows rows;
  for (int x = 0; x < 4; x++) {
    rows.a[x] = bc4_fixed(texel_at(texels, start + ivec2(x, 0))[channel]);
    rows.b[x] = bc4_fixed(texel_at(texels, start + ivec2(x, 1))[channel]);
    rows.c[x] = bc4_fixed(texel_at(texels, start + ivec2(x, 2))[channel]);
    rows.d[x] = bc4_fixed(texel_at(texels, start + ivec2(x, 3))[channel]);
  }
  return rows;
}
