// Takes further samples of the texels of a list at once, by Flatten: for each sample finds the triangle of the high mesh in
// its cell, and adds the normal there. After its last sample, replaces the sum of a texel by the mean.
#include "lib/texture_lib.glsl"
#include "lib/mean_lib.glsl"

// Corners are rounded to so many steps in a texel.
const float GRID = 256.0;

// A corner as a rasterizer has it when the sample is drawn, in steps from the sample; in the same order of operations.
vec2 corner(vec2 uv, vec2 shift, vec2 size, vec2 from)
{
  vec2 place = (uv * uv_to_clip_scale + shift) * (0.5 * size) + 0.5 * size;
  return roundEven((place - 0.5) * GRID) - from;
}

// Whether the point is within the edge from `a` to `b`. A point on the edge belongs to the triangle above it, or on its right.
bool is_within(vec2 a, vec2 b, float turn)
{
  float area = (a.x * b.y - a.y * b.x) * turn;
  vec2 along = (b - a) * turn;
  return area > 0.0 || (area == 0.0 && (along.y < 0.0 || (along.y == 0.0 && along.x > 0.0)));
}

bool is_inside(vec4 one, vec4 two, vec2 shift, vec2 size, vec2 from)
{
  vec2 a = corner(one.xy, shift, size, from);
  vec2 b = corner(one.zw, shift, size, from);
  vec2 c = corner(two.xy, shift, size, from);
  float turn = sign((b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y));
  return turn != 0.0 && is_within(a, b, turn) && is_within(b, c, turn) && is_within(c, a, turn);
}

void main()
{
  int group = int(gl_WorkGroupID.y) * listing.z + int(gl_WorkGroupID.x);
  int number = listing.x + group * 64 + int(gl_LocalInvocationIndex);
  if (number >= listing.y) {
    return;
  }
  vec4 entry = texel_at(listed, texture_place(number));
  ivec2 texel = ivec2(entry.xy);
  int stop = int(entry.z);
  if (stop <= first_sample) {  // this texel has its mean
    return;
  }
  ivec2 square = texel / cell_side;
  vec4 cell = texel_at(cells, square);
  vec2 center = vec2(texel - square * cell_side) + 0.5 - 0.5 * float(cell_side);
  vec2 size = vec2(imageSize(sums));
  vec2 from = vec2(texel) * GRID;
  vec4 sum = imageLoad(sums, texel);
  for (int i = first_sample; i < min(stop, end_sample); i++) {
    vec4 offset = texel_at(offsets, ivec2(i, 0));
    vec2 at = center + offset.xy;
    vec3 normal = vec3(0.0);
    bool is_found = false;
    // The last triangle is the one that stays when all are drawn.
    for (int triangle = int(cell.y) - 1; triangle >= int(cell.x) && !is_found; triangle--) {
      int place = triangle * 4;
      vec4 one = texel_at(triangles, texture_place(place));
      vec4 two = texel_at(triangles, texture_place(place + 1));
      if (is_inside(one, two, offset.zw, size, from)) {
        vec4 three = texel_at(triangles, texture_place(place + 2));
        vec4 four = texel_at(triangles, texture_place(place + 3));
        normal = vec3(two.zw, three.x) + three.yzw * at.x + four.xyz * at.y;
        is_found = dot(normal, normal) > 0.0;
      }
    }
    if (is_found) {
      sum += vec4(normal / sqrt(dot(normal, normal)), 1.0);
    }
  }
  imageStore(sums, texel, stop <= end_sample ? mean_direction(sum) : sum);
}
