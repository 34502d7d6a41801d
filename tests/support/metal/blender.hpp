// SPDX-License-Identifier: GPL-3.0-or-later
// The names of GLSL that Blender's Metal backend defines before a shader: those that 4.5 to 5.2 define.
#pragma once
#include "library.hpp"

#define GPU_METAL

using namespace metal;

typedef float2 vec2;
typedef float3 vec3;
typedef float4 vec4;
typedef int2 ivec2;
typedef int3 ivec3;
typedef int4 ivec4;
typedef uint2 uvec2;
typedef uint3 uvec3;
typedef uint4 uvec4;
typedef bool2 bvec2;
typedef bool3 bvec3;
typedef bool4 bvec4;
typedef float2x2 mat2;
typedef float3x3 mat3;
typedef float4x4 mat4;
typedef float2x2 mat2x2;
typedef float2x3 mat2x3;
typedef float2x4 mat2x4;
typedef float3x2 mat3x2;
typedef float3x3 mat3x3;
typedef float3x4 mat3x4;
typedef float4x2 mat4x2;
typedef float4x3 mat4x3;
typedef float4x4 mat4x4;

// The decorations that the text rules put around the parameters of functions.
#define in
#define out thread
#define inout thread
#define shared threadgroup
#define _in_sta
#define _in_end
#define _out_sta (&
#define _out_end )
#define _inout_sta (&
#define _inout_end )
#define _shared_sta (&
#define _shared_end )
// The text rules put these where an array is initialized, and nowhere else.
#define ARRAY_T(type)
#define ARRAY_V(...) {__VA_ARGS__}

#define discard discard_fragment()
#define inversesqrt rsqrt
#define dFdx(x) dfdx(x)
#define dFdy(x) dfdy(x)
#define lessThan(a, b) ((a) < (b))
#define lessThanEqual(a, b) ((a) <= (b))
#define greaterThan(a, b) ((a) > (b))
#define greaterThanEqual(a, b) ((a) >= (b))
#define equal(a, b) ((a) == (b))
#define notEqual(a, b) ((a) != (b))
#define bitfieldReverse reverse_bits

float radians(float);
float degrees(float);
float distance(float, float);
template<class T> T atan(T y, T x);
template<class T> int bitCount(T);
template<class T> int findLSB(T);
template<class T> int findMSB(T);

#define mod(x, y) blender_mod(x, y)
float blender_mod(float, float);
#define OF_SIZE(size) \
  float##size blender_mod(float##size, float); \
  float##size blender_mod(float##size, float##size); \
  float##size mix(float##size, float##size, float); \
  float##size mix(float##size, float##size, bool##size); \
  int##size mix(int##size, int##size, bool##size); \
  uint##size mix(uint##size, uint##size, bool##size); \
  int##size floatBitsToInt(float##size); \
  uint##size floatBitsToUint(float##size); \
  float##size intBitsToFloat(int##size); \
  float##size uintBitsToFloat(uint##size);
OF_SIZE(2)
OF_SIZE(3)
OF_SIZE(4)
#undef OF_SIZE
int floatBitsToInt(float);
uint floatBitsToUint(float);
float intBitsToFloat(int);
float uintBitsToFloat(uint);

// Where a shader calls mat3(...), the text rules write __mat3x3(...). Other constructors of matrices stay Metal's.
float2x2 __mat2x2(float);
float2x2 __mat2x2(float2, float2);
float2x2 __mat2x2(float, float, float, float);
float2x2 __mat2x2(float3x3);
float2x2 __mat2x2(float4x4);
float3x3 __mat3x3(float);
float3x3 __mat3x3(float3, float3, float3);
float3x3 __mat3x3(float, float, float, float, float, float, float, float, float);
float3x3 __mat3x3(float2x2);
float3x3 __mat3x3(float4x4);
float4x4 __mat4x4(float);
float4x4 __mat4x4(float4, float4, float4, float4);
float4x4 __mat4x4(float, float, float, float, float, float, float, float, float, float, float, float, float, float, float, float);
float4x4 __mat4x4(float2x2);
float4x4 __mat4x4(float3x3);
float2x2 inverse(float2x2);
float3x3 inverse(float3x3);
float4x4 inverse(float4x4);
template<int c, int r> bool operator==(const matrix<c, r> &, const matrix<c, r> &);
template<int c, int r> bool operator!=(const matrix<c, r> &, const matrix<c, r> &);
template<int c, int r> matrix<c, r> operator-(const matrix<c, r> &);

// A sampler or an image of GLSL. Coordinates are int2: no unsigned ones, and no scalars.
template<class T, access A> struct blender_texture { texture2d<T, A> *texture; };
template<class P> using place = typename only_if<is_same<P, int2>::value, int>::type;
template<class T, access A> int2 textureSize(blender_texture<T, A>, int);
template<class T, access A> int2 imageSize(blender_texture<T, A>);
template<class T, class P, place<P> = 0> typename four<T>::type texelFetch(blender_texture<T, access::sample>, P, int);
template<class T> typename four<T>::type texture(blender_texture<T, access::sample>, float2);
template<class T> typename four<T>::type textureLod(blender_texture<T, access::sample>, float2, float);
template<class T, access A, class P, place<P> = 0>
auto imageLoad(blender_texture<T, A> image, P at) -> decltype(image.texture->read(construct<uint2>(at)));
template<class T, access A, class P, class V, place<P> = 0>
auto imageStore(blender_texture<T, A> image, P at, V value)
    -> typename only_if<is_same<V, typename four<T>::type>::value, decltype(image.texture->write(value, construct<uint2>(at)))>::type;
template<class T, access A> auto imageFence(blender_texture<T, A> image) -> decltype(image.texture->fence());

// Constructors of vectors, see library.hpp.
#define vec2(...) construct<float2>(__VA_ARGS__)
#define vec3(...) construct<float3>(__VA_ARGS__)
#define vec4(...) construct<float4>(__VA_ARGS__)
#define ivec2(...) construct<int2>(__VA_ARGS__)
#define ivec3(...) construct<int3>(__VA_ARGS__)
#define ivec4(...) construct<int4>(__VA_ARGS__)
#define uvec2(...) construct<uint2>(__VA_ARGS__)
#define uvec3(...) construct<uint3>(__VA_ARGS__)
#define uvec4(...) construct<uint4>(__VA_ARGS__)
#define bvec2(...) construct<bool2>(__VA_ARGS__)
#define bvec3(...) construct<bool3>(__VA_ARGS__)
#define bvec4(...) construct<bool4>(__VA_ARGS__)
#define float2(...) construct<float2>(__VA_ARGS__)
#define float3(...) construct<float3>(__VA_ARGS__)
#define float4(...) construct<float4>(__VA_ARGS__)
#define int2(...) construct<int2>(__VA_ARGS__)
#define int3(...) construct<int3>(__VA_ARGS__)
#define int4(...) construct<int4>(__VA_ARGS__)
#define uint2(...) construct<uint2>(__VA_ARGS__)
#define uint3(...) construct<uint3>(__VA_ARGS__)
#define uint4(...) construct<uint4>(__VA_ARGS__)
