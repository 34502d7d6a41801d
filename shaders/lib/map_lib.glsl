// How a normal map is read. `placed` holds in its columns 0 to 2 the normal matrix of the low object, and in the fourth
// components of these: how many steps from 0 to 1 the map is stored in (0: as it is), a MAP_ kind, and which axes its
// channels hold, as digits to the base 6 of +X, -X, +Y, -Y, +Z, -Z, red's being the lowest.
#include "lib/basis_lib.glsl"

const int MAP_WORLD = 0;
const int MAP_OBJECT = 1;
const int MAP_MIKKTSPACE = 2;
const int MAP_BLENDER = 3;

vec3 map_stored(ivec2 texel)
{
  vec3 value = texelFetch(normal_map, clamp(texel, ivec2(0), textureSize(normal_map, 0) - 1), 0).rgb;
  float steps = placed[0].w;
  return steps > 0.0 ? floor(value * steps + 0.5) / steps : value;
}

// Bilinear between texel centers. Samplers round the weights to 8 bits, and not all GPUs filter single precision.
vec3 map_between(vec2 uv)
{
  vec2 place = uv * vec2(textureSize(normal_map, 0)) - 0.5;
  ivec2 texel = ivec2(floor(place));
  vec2 weight = place - floor(place);
  return mix(mix(map_stored(texel), map_stored(texel + ivec2(1, 0)), weight.x),
             mix(map_stored(texel + ivec2(0, 1)), map_stored(texel + ivec2(1, 1)), weight.x),
             weight.y);
}

vec3 map_unit(vec3 vector)
{
  return vector / max(length(vector), 1e-20);
}

// From the space of object-space normals, or for a world-space map from the world, to the world; of length one.
vec3 map_to_world(vec3 normal)
{
  return map_unit(int(placed[1].w) == MAP_WORLD ? normal : mat3(placed) * normal);
}

// The normal in world space that a stored color stands for where the low mesh has this normal and tangent.
vec3 map_normal(vec3 stored, vec3 normal, vec4 tangent)
{
  vec3 shown = vec3(0.0);
  int axes = int(placed[2].w);
  for (int channel = 0; channel < 3; channel++) {
    int axis = axes % 6;
    shown[axis / 2] = (stored[channel] * 2.0 - 1.0) * (axis % 2 == 0 ? 1.0 : -1.0);
    axes /= 6;
  }
  int kind = int(placed[1].w);
  if (kind == MAP_MIKKTSPACE || kind == MAP_BLENDER) {
    shown = basis_vector(shown, tangent.xyz, tangent.w, kind == MAP_BLENDER ? map_unit(normal) : normal);
  }
  return map_to_world(map_unit(shown));
}
