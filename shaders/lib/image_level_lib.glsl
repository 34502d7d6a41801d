// How the pixels of a level of an image cover those of the level before: pixel i of n covers the part i / n to (i + 1) / n.

// The shares of pixels 2 i - 1, 2 i and 2 i + 1, of `size`, in pixel i of the next level. Where `size` is odd, the next level
// has (size + 1) / 2 pixels, each a little less than two wide.
vec3 image_level_weights(int i, int size)
{
  if (size == 1) {
    return vec3(0.0, 1.0, 0.0);
  }
  if (size % 2 == 0) {
    return vec3(0.0, 0.5, 0.5);
  }
  int count = (size + 1) / 2;
  return vec3(float(i), float(count), float(count - 1 - i)) / float(size);
}
