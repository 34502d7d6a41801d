// Reads a normal map. Columns 0 to 2 of `shading` hold the normal matrix of the low object. Their fourth components hold the
// number of steps between 0 and 1 to which the map is rounded (0: not rounded), a MAP_ kind, and the axes of the channels:
// digits in base 6 for +X, -X, +Y, -Y, +Z, -Z, with red in the lowest.
#include "lib/basis_lib.glsl"

const int MAP_WORLD = 0;
const int MAP_OBJECT = 1;
const int MAP_TANGENT = 2;  // plus the flags of its basis

vec3 map_stored(ivec2 texel)
{
  vec3 value = texelFetch(normal_map, clamp(texel, ivec2(0), textureSize(normal_map, 0) - 1), 0).rgb;
  float steps = shading[0].w;
  return steps > 0.0 ? floor(value * steps + 0.5) / steps : value;
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
  return basis_unit(int(shading[1].w) == MAP_WORLD ? normal : mat3(shading) * normal);
}

// The world-space normal that a stored color means, with the normal, tangent and bitangent of the low mesh.
vec3 map_normal(vec3 stored, vec3 normal, vec4 tangent, vec3 bitangent)
{
  vec3 shown = vec3(0.0);
  int axes = int(shading[2].w);
  for (int channel = 0; channel < 3; channel++) {
    int axis = axes % 6;
    shown[axis / 2] = (stored[channel] * 2.0 - 1.0) * (axis % 2 == 0 ? 1.0 : -1.0);
    axes /= 6;
  }
  int kind = int(shading[1].w);
  if (kind >= MAP_TANGENT) {
    shown = basis_of(kind - MAP_TANGENT, normal, tangent, bitangent) * shown;
  }
  return map_to_world(basis_unit(shown));
}
