// Turns the normals at hits as a tangent-space normal map of the high mesh says, as Cycles' Normal Map node does. row_u.w: the
// width of a sample, in texels; row_v.w: the strength. limits: of the stored values. The last row of to_space is their
// scale, its last column their offset.
#include "lib/footprint_lib.glsl"
#include "lib/served_lib.glsl"
#include "lib/image_lib.glsl"
#include "lib/channel_lib.glsl"
#include "lib/normal_space_lib.glsl"

// A flag of image_flags: green points down the tangent space, as DirectX has it.
const int GREEN_DOWN = 8;

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
  bool is_fed = !hit_missed(hit) && drawn.a > 0.0 &&
                int(texelFetch(materials, texture_place(corners.material), 0).a) == feed &&
                (tile == 0 || !footprint_is_outside(place));
  if (is_fed) {
    ivec3 numbers = triangle_numbers(texelFetch(tangent_triangles, texture_place(triangle), 0));
    vec4 tangent = texelFetch(tangents, texture_place(numbers.x), 0);
    tangent.xyz = triangle_mixed(tangent,
                                 texelFetch(tangents, texture_place(numbers.y), 0),
                                 texelFetch(tangents, texture_place(numbers.z), 0),
                                 hit_weights(hit))
                      .xyz;
    mat2 footprint = footprint_of(texel, hit, uv, corners, footprint_to_pixels(textureSize(image_pixels, 0))) * row_u.w;
    vec3 stored = clamp(channel_of(image_mean(place, image_axes(footprint)), channel), vec3(limits.x), vec3(limits.y));
    vec3 scale = vec3(to_space[0].w, to_space[1].w, to_space[2].w);
    vec3 mapped = (stored * scale + to_space[3].xyz) * 2.0 - 1.0;
    mapped.y *= (image_flags & GREEN_DOWN) != 0 ? -1.0 : 1.0;
    float strength = row_v.w;
    mapped = vec3(mapped.xy * strength, mix(1.0, mapped.z, clamp(strength, 0.0, 1.0)));
    // Cycles normalizes the interpolated normal, and not the tangent.
    vec3 normal = normal_space_to_world(drawn.xyz);
    vec3 turned = mapped.x * tangent.xyz + mapped.y * tangent.w * cross(normal, tangent.xyz) + mapped.z * normal;
    vec3 found = normal_space_from_world(turned);
    if (dot(tangent.xyz, tangent.xyz) > 0.0 && dot(found, found) > 0.0) {
      imageStore(normals, texel, vec4(found, 1.0));
    }
  }
}
