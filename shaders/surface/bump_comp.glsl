// Turns the normals at hits as a bump map of the high mesh says, as Cycles' Bump node does. row_u.w: the width of a sample, in
// texels; row_v.w: the strength. limits: of the value. The last column of to_space has how far the value 1 is out, in the units
// of the corners.
#include "lib/footprint_lib.glsl"
#include "lib/served_lib.glsl"
#include "lib/image_lib.glsl"
#include "lib/channel_lib.glsl"
#include "lib/normal_space_lib.glsl"

void main()
{
  ivec2 texel = served_texel();
  if (any(greaterThanEqual(texel, texel_size(hits)))) {
    return;
  }
  uvec4 hit = texel_at(hits, texel);
  int triangle = max(hit_triangle(hit), 0);
  FootprintUvs corners = footprint_uvs(triangle);
  vec2 uv = footprint_uv(hit, corners);
  vec2 place = footprint_in_tile(footprint_mapped(uv), tile);
  vec4 drawn = imageLoad(normals, texel);
  bool is_fed = !hit_missed(hit) && int(texelFetch(materials, texture_place(corners.material), 0).a) == feed &&
                (tile == 0 || !footprint_is_outside(place));
  if (is_fed) {
    ivec2 size = textureSize(image_pixels, 0);
    mat2 to_pixels = footprint_to_pixels(size);
    vec3 axes = image_axes(footprint_of(texel, hit, uv, corners, to_pixels) * row_u.w);
    // The change of the height for one pixel along u and along v, from half a pixel of the averaged image on both sides.
    float width = image_width(axes);
    vec2 slope = vec2(0.0);
    for (int side = 0; side < 4; side++) {
      vec2 along = vec2(1 - side / 2, side / 2) * (side % 2 == 0 ? -1.0 : 1.0);
      vec4 color = image_mean(place + along * 0.5 * width / vec2(size), axes);
      slope += along * clamp(channel_of(color, channel).r, limits.x, limits.y) / width;
    }
    // J. Blinn, "Simulation of wrinkled surfaces" (1978), by the gradient along two edges of the triangle.
    ivec3 vertices = triangle_numbers(texel_at(triangles, texture_place(triangle)));
    TriangleEdges edges = TRIANGLE_EDGES(points, vertices);
    vec2 rises = vec2(dot(slope, to_pixels * (corners.b - corners.a)),
                      dot(slope, to_pixels * (corners.c - corners.a)));
    float scale = triangle_scale(edges);
    vec3 edge1 = edges.edge1 * scale, edge2 = edges.edge2 * scale;
    vec3 normal = normal_space_to_world(drawn.xyz);
    vec3 across1 = cross(edge2, normal);
    vec3 across2 = cross(normal, edge1);
    float determinant = dot(edge1, across1);
    float rise = to_space[3].x;
    vec3 gradient = (rises.x * across1 + rises.y * across2) * scale;
    vec3 turned = normal_space_unit(abs(determinant) * normal - sign(determinant) * rise * gradient);
    float strength = row_v.w;
    vec3 found = normal_space_from_world(strength * turned + (1.0 - strength) * normal);
    if (determinant != 0.0 && dot(found, found) > 0.0) {
      imageStore(normals, texel, vec4(found, 1.0));
    }
  }
}
