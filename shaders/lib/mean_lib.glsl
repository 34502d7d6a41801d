// The mean of samples from their sum, as accumulate_lib.glsl has it. Alpha is as for a single sample: a texel is missed only if
// none of its rays hit.

vec4 mean_without_hit(vec4 sum)
{
  return vec4(0.0, 0.0, 0.0, sum.a > 0.0 ? -1.0 : 0.0);
}

// Of directions, which are normalized again.
vec4 mean_direction(vec4 sum)
{
  float length_squared = dot(sum.xyz, sum.xyz);
  return sum.a >= 1.0 && length_squared > 0.0 ? vec4(sum.xyz / sqrt(length_squared), 1.0) : mean_without_hit(sum);
}

// Of other values.
vec4 mean_value(vec4 sum)
{
  return sum.a >= 1.0 ? vec4(sum.xyz / floor(sum.a), 1.0) : mean_without_hit(sum);
}
