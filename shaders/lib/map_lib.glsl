// Reads a normal map. Columns 0 to 2 of `shading` hold the normal matrix of the low object. Their fourth components hold how
// the map is read: the steps, the kind and the axes of decode_lib.
#include "lib/decode_lib.glsl"

vec3 map_stored(ivec2 texel)
{
  vec3 value = texelFetch(normal_map, clamp(texel, ivec2(0), textureSize(normal_map, 0) - 1), 0).rgb;
  return decode_rounded(value, shading[0].w);
}

// Bilinear interpolation between texel centers. Samplers round the weights to 8 bits, and not all GPUs filter float32.
vec3 map_between(vec2 uv)
{
  vec2 place = uv * vec2(textureSize(normal_map, 0)) - 0.5;
  ivec2 texel = ivec2(floor(place));
  vec2 weight = place - floor(place);
  return mix(mix(map_stored(texel), map_stored(texel + ivec2(1, 0)), weight.x),
             mix(map_stored(texel + ivec2(0, 1)), map_stored(texel + ivec2(1, 1)), weight.x),
             weight.y);
}

// Transforms a normal from object space, or for a world-space map from world space, to world space, and normalizes it.
vec3 map_to_world(vec3 normal)
{
  return basis_unit(int(shading[1].w) == DECODE_WORLD ? normal : mat3(shading) * normal);
}

// The world-space normal that a stored color means, with the normal, tangent and bitangent of the low mesh.
vec3 map_normal(vec3 stored, vec3 normal, vec4 tangent, vec3 bitangent)
{
  return map_to_world(decode_normal(stored, int(shading[1].w), int(shading[2].w), normal, tangent, bitangent));
}
