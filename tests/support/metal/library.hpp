// SPDX-License-Identifier: GPL-3.0-or-later
// What the shaders use of Metal's standard library, as declarations for clang -fsyntax-only. A name or an overload that Metal
// does not have is not here, so that its use is an error. Metal's compiler is a clang, and its vectors are clang's vectors:
// operators, swizzles and conversions are the same. Three things differ. Clang's C++ has no constructors of vectors, for which
// blender.hpp has macros. Its comparisons give vectors of int, where Metal's give vectors of bool. Address spaces are empty.
#pragma once

typedef unsigned short ushort;
typedef unsigned int uint;
typedef _Float16 half_scalar;

// Words that Metal reserves: as the name of a variable they leave an error behind.
#define device
#define constant
#define thread
#define threadgroup
#define vertex
#define fragment
#define kernel
#define half half_scalar

#define VECTORS(scalar, name) \
  typedef scalar name##2 __attribute__((ext_vector_type(2))); \
  typedef scalar name##3 __attribute__((ext_vector_type(3))); \
  typedef scalar name##4 __attribute__((ext_vector_type(4)));
VECTORS(float, float)
VECTORS(int, int)
VECTORS(uint, uint)
VECTORS(half_scalar, half)
#undef VECTORS
typedef int2 bool2;
typedef int3 bool3;
typedef int4 bool4;

namespace metal {

// The scalar type of a vector and its number of components.
template<class T> struct shape { static constexpr int count = 0; };
#define SHAPE(type, scalar, number) \
  template<> struct shape<type> { typedef scalar element; static constexpr int count = number; };
#define SHAPES(type) \
  SHAPE(type, type, 1) SHAPE(type##2, type, 2) SHAPE(type##3, type, 3) SHAPE(type##4, type, 4)
SHAPES(float)
SHAPES(int)
SHAPES(uint)
SHAPES(half)
SHAPE(bool, bool, 1)
#undef SHAPE
#undef SHAPES

template<class A, class B> struct is_same { static constexpr bool value = false; };
template<class A> struct is_same<A, A> { static constexpr bool value = true; };
template<bool condition, class T> struct only_if {};
template<class T> struct only_if<true, T> { typedef T type; };

// Whether a constructor of vectors of T takes these arguments in a row, and how many components they have together.
template<class T, class... A> struct row { static constexpr int count = 0; static constexpr bool fits = true; };
template<class T, class A, class... B> struct row<T, A, B...> {
  static constexpr int count = shape<A>::count + row<T, B...>::count;
  static constexpr bool fits = (shape<A>::count == 1 || is_same<typename shape<A>::element, T>::value) && row<T, B...>::fits;
};

// A scalar for all components, or as many components of another type. GLSL also cuts longer vectors; Metal does not.
template<class V, class A>
typename only_if<shape<A>::count == 1 || shape<A>::count == shape<V>::count, V>::type construct(A);
// Scalars of any type, and vectors of the same type, with as many components as V. GLSL also converts vectors here.
template<class V, class A, class B, class... C>
typename only_if<row<typename shape<V>::element, A, B, C...>::fits &&
                   row<typename shape<V>::element, A, B, C...>::count == shape<V>::count, V>::type construct(A, B, C...);

// Matrices by columns. There is no constructor from another matrix, no division and no comparison.
template<int rows> struct column;
template<> struct column<2> { typedef float2 type; };
template<> struct column<3> { typedef float3 type; };
template<> struct column<4> { typedef float4 type; };

template<class... A> struct all_scalars { static constexpr bool value = true; };
template<class A, class... B> struct all_scalars<A, B...> {
  static constexpr bool value = shape<A>::count == 1 && all_scalars<B...>::value;
};
template<class V, class... A> struct all_columns { static constexpr bool value = true; };
template<class V, class A, class... B> struct all_columns<V, A, B...> {
  static constexpr bool value = is_same<V, A>::value && all_columns<V, B...>::value;
};

template<int columns, int rows> struct matrix {
  typedef typename column<rows>::type vector;
  vector stored[columns];
  matrix() = default;
  explicit matrix(float diagonal);
  template<class... A, class = typename only_if<(sizeof...(A) == columns && all_columns<vector, A...>::value) ||
                                                  (sizeof...(A) == columns * rows && all_scalars<A...>::value), int>::type>
  matrix(A...);
  vector &operator[](int i) { return stored[i]; }
  const vector &operator[](int i) const { return stored[i]; }
};
#define MATRICES(columns) \
  typedef matrix<columns, 2> float##columns##x2; \
  typedef matrix<columns, 3> float##columns##x3; \
  typedef matrix<columns, 4> float##columns##x4;
MATRICES(2)
MATRICES(3)
MATRICES(4)
#undef MATRICES
#define PRODUCTS(c, r) \
  float##r operator*(const float##c##x##r &, float##c); \
  float##c operator*(float##r, const float##c##x##r &); \
  float##c##x##r operator*(const float##c##x##r &, float); \
  float##c##x##r operator*(float, const float##c##x##r &); \
  float##c##x##r operator+(const float##c##x##r &, const float##c##x##r &); \
  float##c##x##r operator-(const float##c##x##r &, const float##c##x##r &); \
  float##r##x##c transpose(const float##c##x##r &);
PRODUCTS(2, 2) PRODUCTS(2, 3) PRODUCTS(2, 4)
PRODUCTS(3, 2) PRODUCTS(3, 3) PRODUCTS(3, 4)
PRODUCTS(4, 2) PRODUCTS(4, 3) PRODUCTS(4, 4)
#undef PRODUCTS
template<int a, int b, int c> matrix<c, b> operator*(const matrix<a, b> &, const matrix<c, a> &);
float determinant(const float2x2 &);
float determinant(const float3x3 &);
float determinant(const float4x4 &);

// Functions of numbers. Each has an overload for half as well, so that a call with a whole number is ambiguous.
#define ONE(type, name) type name(type);
#define TWO(type, name) type name(type, type);
#define THREE(type, name) type name(type, type, type);
#define EACH(form, type, name) form(type, name) form(type##2, name) form(type##3, name) form(type##4, name)
#define OF_FLOATS(form, name) EACH(form, float, name) EACH(form, half, name)
#define OF_NUMBERS(form, name) OF_FLOATS(form, name) EACH(form, int, name) EACH(form, uint, name)
OF_FLOATS(ONE, acos) OF_FLOATS(ONE, acosh) OF_FLOATS(ONE, asin) OF_FLOATS(ONE, asinh) OF_FLOATS(ONE, atan)
OF_FLOATS(ONE, atanh) OF_FLOATS(ONE, ceil) OF_FLOATS(ONE, cos) OF_FLOATS(ONE, cosh) OF_FLOATS(ONE, exp)
OF_FLOATS(ONE, exp2) OF_FLOATS(ONE, floor) OF_FLOATS(ONE, fract) OF_FLOATS(ONE, log) OF_FLOATS(ONE, log2)
OF_FLOATS(ONE, rint) OF_FLOATS(ONE, round) OF_FLOATS(ONE, rsqrt) OF_FLOATS(ONE, saturate) OF_FLOATS(ONE, sign)
OF_FLOATS(ONE, sin) OF_FLOATS(ONE, sinh) OF_FLOATS(ONE, sqrt) OF_FLOATS(ONE, tan) OF_FLOATS(ONE, tanh)
OF_FLOATS(ONE, trunc) OF_FLOATS(ONE, fabs) OF_FLOATS(ONE, dfdx) OF_FLOATS(ONE, dfdy) OF_FLOATS(ONE, fwidth)
OF_FLOATS(TWO, atan2) OF_FLOATS(TWO, fmod) OF_FLOATS(TWO, pow) OF_FLOATS(TWO, step) OF_FLOATS(TWO, copysign)
OF_FLOATS(THREE, fma) OF_FLOATS(THREE, mix) OF_FLOATS(THREE, smoothstep)
OF_NUMBERS(TWO, max) OF_NUMBERS(TWO, min) OF_NUMBERS(THREE, clamp)
OF_FLOATS(ONE, abs) EACH(ONE, int, abs)
#define OF_BITS(name) EACH(ONE, int, name) EACH(ONE, uint, name)
OF_BITS(clz) OF_BITS(ctz) OF_BITS(popcount) OF_BITS(reverse_bits)

// Functions of vectors, which have no form for scalars.
#define GEOMETRY(type, name) \
  type dot(name, name); \
  type length(name); \
  type length_squared(name); \
  type distance(name, name); \
  type distance_squared(name, name); \
  name normalize(name); \
  name reflect(name, name); \
  name faceforward(name, name, name);
GEOMETRY(float, float2) GEOMETRY(float, float3) GEOMETRY(float, float4)
GEOMETRY(half, half2) GEOMETRY(half, half3) GEOMETRY(half, half4)
float3 cross(float3, float3);
half3 cross(half3, half3);

#define TESTS(size) \
  bool all(bool##size); \
  bool any(bool##size); \
  float##size select(float##size, float##size, bool##size); \
  int##size select(int##size, int##size, bool##size); \
  uint##size select(uint##size, uint##size, bool##size); \
  bool##size isnan(float##size); \
  bool##size isinf(float##size);
TESTS(2) TESTS(3) TESTS(4)
bool isnan(float);
bool isinf(float);

void discard_fragment();

// `To` and `From` have the same size.
template<class To, class From> typename only_if<sizeof(To) == sizeof(From), To>::type as_type(From);

#undef ONE
#undef TWO
#undef THREE
#undef EACH
#undef OF_FLOATS
#undef OF_NUMBERS
#undef OF_BITS
#undef GEOMETRY
#undef TESTS

enum class access { sample, read, write, read_write };

template<class T> struct four;
template<> struct four<float> { typedef float4 type; };
template<> struct four<int> { typedef int4 type; };
template<> struct four<uint> { typedef uint4 type; };

// A texture has the methods that its access allows.
template<class T, access A> struct texture2d;
template<class T> struct texture2d<T, access::sample> {
  typename four<T>::type sample(float2);
  typename four<T>::type read(uint2);
};
template<class T> struct texture2d<T, access::read> { typename four<T>::type read(uint2); };
template<class T> struct texture2d<T, access::write> { void write(typename four<T>::type, uint2); };
template<class T> struct texture2d<T, access::read_write> {
  typename four<T>::type read(uint2);
  void write(typename four<T>::type, uint2);
  void fence();
};

}  // namespace metal
