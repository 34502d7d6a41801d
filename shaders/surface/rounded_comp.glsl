// Rounds the normals at hits near hard edges: the mean of the surface's normals within a ball around the hit, weighted as by Cycles'
// Bevel node. Only smooth parts count that hard edges within the ball connect with the hit's own: not what lies close by chance.
// Hits without such an edge keep their normals.
//
// to_space: its last column has the origin of the tree over edges. edge_scale.w: the first leaf of that tree. grid_origin.w: the
// radius. A normal with alpha 2 is unfinished.
#include "lib/block_lib.glsl"
#include "lib/hit_lib.glsl"
#include "lib/triangle_lib.glsl"
#include "lib/tree_lib.glsl"
#include "lib/closest_lib.glsl"
#include "lib/normal_space_lib.glsl"
#include "lib/ball_lib.glsl"

const bool CARRIED_GOES_ON = true;
#include "lib/carried_lib.glsl"

// Where the radius ends, what is rounded becomes what is not: from this share of it on.
const float ROUNDED_FADE = 0.9;
// 16 smooth parts are told apart in a ball. With more, all of the surface in the ball counts.
const int ROUNDED_ALL = 17;
const float ROUNDED_UNFINISHED = 2.0;
// The texels of a lane in `carried`.
const int ROUNDED_CARRIED = 6;
const float ROUNDED_SAME = 1e-12;

// The parts that are connected with the hit's own, -1 where there is none.
struct RoundedParts {
  ivec4 first, second, third, fourth;
  int count;
};

bool rounded_has(RoundedParts parts, int part)
{
  ivec4 four = ivec4(part);
  return any(equal(parts.first, four)) || any(equal(parts.second, four)) || any(equal(parts.third, four)) ||
         any(equal(parts.fourth, four)) || parts.count == ROUNDED_ALL;
}

void rounded_add(inout RoundedParts parts, int part)
{
  ivec4 slot = ivec4(parts.count) - ivec4(0, 1, 2, 3);
  ivec4 four = ivec4(part);
  parts.first += (four - parts.first) * ivec4(equal(slot, ivec4(0)));
  parts.second += (four - parts.second) * ivec4(equal(slot, ivec4(4)));
  parts.third += (four - parts.third) * ivec4(equal(slot, ivec4(8)));
  parts.fourth += (four - parts.fourth) * ivec4(equal(slot, ivec4(12)));
  parts.count = min(parts.count + 1, ROUNDED_ALL);
}

int rounded_part(int triangle)
{
  vec4 four = texelFetch(part_numbers, texture_place(triangle >> 2), 0);
  int slot = triangle & 3;
  return floatBitsToInt(slot < 2 ? (slot == 0 ? four.x : four.y) : (slot == 2 ? four.z : four.w)) - TRIANGLE_FIRST;
}

// A walk over the edges until no part is new, then one over the triangles. node: -1 at the start.
struct RoundedWalk {
  int node;
  uvec2 trail;
  bool is_over_edges;
  bool has_new;
  RoundedParts parts;
  float nearest;
  vec3 sum;
};

// The unit normal in world space at a point of a triangle.
vec3 rounded_normal(ivec3 numbers, vec2 weights)
{
  vec4 mixed = triangle_mixed(texelFetch(corner_normals, texture_place(numbers.x), 0),
                              texelFetch(corner_normals, texture_place(numbers.y), 0),
                              texelFetch(corner_normals, texture_place(numbers.z), 0),
                              weights);
  return normal_space_unit(mixed.xyz);
}

// The integral of the weight times the normal over a triangle.
vec3 rounded_triangle(int triangle, vec3 center, float radius)
{
  vec4 texel = texel_at(triangles, texture_place(triangle));
  ivec3 vertices = triangle_numbers(texel);
  TriangleEdges edges = TRIANGLE_EDGES(points, vertices);
  vec3 corner = (edges.corner - center) / radius;
  vec3 edge1 = edges.edge1 / radius, edge2 = edges.edge2 / radius;
  vec4 moments = ball_moments(corner, corner + edge1, corner + edge2);
  if (moments.w <= 0.0) {
    return vec3(0.0);
  }
  // The normal at the center of gravity.
  vec3 way = moments.xyz / moments.w - corner;
  float a = dot(edge1, edge1), b = dot(edge1, edge2), c = dot(edge2, edge2);
  float u = dot(way, edge1), v = dot(way, edge2);
  vec2 weights = vec2(c * u - b * v, a * v - b * u) / max(a * c - b * b, 1e-30);
  return moments.w * rounded_normal(triangle_normals(texel), clamp(weights, vec2(0.0), vec2(1.0)));
}

void rounded_walk_edges(vec3 center, float radius, inout RoundedWalk walk, inout int turns)
{
  vec3 grid_point = (center - to_space[3].xyz) * edge_scale.xyz;
  vec3 unit = 1.0 / edge_scale.xyz;
  float limit = radius * radius;
  while (walk.is_over_edges && turns > 0) {
    turns -= 2;  // also the turn in which the loop over edges ends
    int leaf = 0;
    uint mask = tree_closer(TREE_BOXES(edge_nodes, walk.node), grid_point, unit, limit);
    uint found = tree_step(mask, int(edge_scale.w), walk.node, walk.trail, leaf);
    while (found != 0u) {
      int edge = leaf + findLSB(found);
      found &= found - 1u;
      turns--;
      vec4 start = texel_at(edge_ends, texture_place(edge * 2));
      vec4 stop = texel_at(edge_ends, texture_place(edge * 2 + 1));
      vec3 to_edge = closest_on_segment(center, start.xyz, stop.xyz) - center;
      float squared = dot(to_edge, to_edge);
      int one = triangle_fourth(start), other = triangle_fourth(stop);
      bool has_one = rounded_has(walk.parts, one), has_other = rounded_has(walk.parts, other);
      if (squared < limit && (has_one || has_other)) {
        walk.nearest = min(walk.nearest, squared);
        if (!(has_one && has_other)) {
          rounded_add(walk.parts, has_one ? other : one);
          walk.has_new = true;
        }
      }
    }
    if (walk.node < 0) {
      walk.node = 0;
      walk.trail = uvec2(0u);
      walk.is_over_edges = walk.has_new;
      walk.has_new = false;
    }
  }
}

void rounded_walk_triangles(vec3 center, float radius, inout RoundedWalk walk, inout int turns)
{
  vec3 grid_point = (center - grid_origin.xyz) * grid_scale.xyz;
  vec3 unit = 1.0 / grid_scale.xyz;
  while (walk.node >= 0 && turns > 0) {
    turns -= TURNS_OF_VISIT;
    uint found = 0u;
    int leaf = 0;
    while (walk.node >= 0 && found == 0u && turns > 0) {
      turns--;
      uint mask = tree_closer(TREE_BOXES(nodes, walk.node), grid_point, unit, radius * radius);
      found = tree_step(mask, first_leaf, walk.node, walk.trail, leaf);
    }
    while (found != 0u) {
      int triangle = leaf + findLSB(found);
      found &= found - 1u;
      turns -= 5;  // also those of the loop over its edges
      if (rounded_has(walk.parts, rounded_part(triangle))) {
        walk.sum += rounded_triangle(triangle, center, radius);
      }
    }
  }
}

void rounded_go_on(inout RoundedWalk walk)
{
  uvec4 left = imageLoad(carried, carried_place(0, ROUNDED_CARRIED));
  walk.node = int(left.x);
  walk.trail = left.yz;
  walk.is_over_edges = (left.w & 1u) != 0u;
  walk.has_new = (left.w & 2u) != 0u;
  walk.parts.count = int(left.w >> 2);
  vec4 sum = uintBitsToFloat(imageLoad(carried, carried_place(1, ROUNDED_CARRIED)));
  walk.sum = sum.xyz;
  walk.nearest = sum.w;
  walk.parts.first = ivec4(imageLoad(carried, carried_place(2, ROUNDED_CARRIED)));
  walk.parts.second = ivec4(imageLoad(carried, carried_place(3, ROUNDED_CARRIED)));
  walk.parts.third = ivec4(imageLoad(carried, carried_place(4, ROUNDED_CARRIED)));
  walk.parts.fourth = ivec4(imageLoad(carried, carried_place(5, ROUNDED_CARRIED)));
}

void rounded_leave(ivec2 texel, vec3 normal, RoundedWalk walk)
{
  carried_note();
  imageStore(normals, texel, vec4(normal, ROUNDED_UNFINISHED));
  if (carried_stage() == CARRIED_ALL) {
    return;
  }
  uint flags = (walk.is_over_edges ? 1u : 0u) | (walk.has_new ? 2u : 0u) | uint(walk.parts.count) << 2;
  imageStore(carried, carried_place(0, ROUNDED_CARRIED), uvec4(uint(walk.node), walk.trail, flags));
  imageStore(carried, carried_place(1, ROUNDED_CARRIED), floatBitsToUint(vec4(walk.sum, walk.nearest)));
  imageStore(carried, carried_place(2, ROUNDED_CARRIED), uvec4(walk.parts.first));
  imageStore(carried, carried_place(3, ROUNDED_CARRIED), uvec4(walk.parts.second));
  imageStore(carried, carried_place(4, ROUNDED_CARRIED), uvec4(walk.parts.third));
  imageStore(carried, carried_place(5, ROUNDED_CARRIED), uvec4(walk.parts.fourth));
}

void main()
{
  ivec2 texel = block_texel(carried_row());
  if (any(greaterThanEqual(texel, textureSize(hits, 0)))) {
    return;
  }
  vec4 drawn = imageLoad(normals, texel);
  uvec4 hit = texelFetch(hits, texel, 0);
  bool is_left = drawn.a == ROUNDED_UNFINISHED;
  if (hit_missed(hit) || drawn.a <= 0.0 || (carried_stage() != CARRIED_ALL) != is_left) {
    return;
  }
  float radius = grid_origin.w;
  vec4 own = texel_at(triangles, texture_place(hit_triangle(hit)));
  ivec3 vertices = triangle_numbers(own);
  TriangleEdges edges = TRIANGLE_EDGES(points, vertices);
  vec3 center = triangle_point(edges, hit_weights(hit));
  RoundedWalk walk;
  walk.node = 0;
  walk.trail = uvec2(0u);
  walk.is_over_edges = true;
  walk.has_new = false;
  walk.nearest = radius * radius;
  walk.sum = vec3(0.0);
  walk.parts.first = walk.parts.second = walk.parts.third = walk.parts.fourth = ivec4(-1);
  walk.parts.count = 0;
  rounded_add(walk.parts, rounded_part(hit_triangle(hit)));
  if (carried_stage() == CARRIED_ON) {
    rounded_go_on(walk);
  }
  int turns = TURNS_MOST;
  rounded_walk_edges(center, radius, walk, turns);
  bool is_near = walk.nearest < radius * radius;
  if (!walk.is_over_edges && is_near) {
    rounded_walk_triangles(center, radius, walk, turns);
  }
  if (walk.is_over_edges || (is_near && walk.node >= 0)) {
    rounded_leave(texel, drawn.xyz, walk);
    return;
  }
  vec3 found = drawn.xyz;
  vec3 normal = rounded_normal(triangle_normals(own), hit_weights(hit));
  if (is_near && dot(walk.sum, walk.sum) > ROUNDED_SAME) {
    float fade = clamp((1.0 - sqrt(walk.nearest) / radius) / (1.0 - ROUNDED_FADE), 0.0, 1.0);
    vec3 rounded = normal_space_unit(mix(normal, normal_space_unit(walk.sum), fade));
    // As the Bevel node turns a normal that it is given, as by a normal map.
    vec3 turned = normal_space_from_world(normal_space_to_world(found) + rounded - normal);
    found = dot(turned, turned) > 0.0 ? turned : found;
  }
  if (is_near || is_left) {
    imageStore(normals, texel, vec4(found, 1.0));
  }
}
