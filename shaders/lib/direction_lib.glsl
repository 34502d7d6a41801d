// Vectors without a direction.

// `length_squared`: of a vector. Beyond these limits, rounding made it, or it is not a number.
bool direction_exists(float length_squared)
{
  return length_squared > 1e-30 && length_squared < 1e30;
}
