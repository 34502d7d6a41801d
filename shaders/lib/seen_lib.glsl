// What a viewer sees of meshes in a picture of a view.
#include "lib/basis_lib.glsl"

// Instead of 1 + the angle: what is known of a pixel whose angle is not.
const float SEEN_NOTHING = 0.0;
const float SEEN_LOW_ALONE = -1.0;
const float SEEN_HIGH_ALONE = -2.0;
const float SEEN_OTHERS = -3.0;  // a part of the low mesh that is not judged

// Added to depths, so that 0 is what no mesh covers.
const float SEEN_COVERED = 1.0;

// Added to depths of back faces, too.
const float SEEN_BACK = 2.0;

bool seen_is_back(float alpha)
{
  return alpha > SEEN_COVERED + 0.5 * SEEN_BACK + 0.5;
}

// Renderers turn the normals of back faces to the viewer's side.
vec3 seen_normal(vec3 normal, bool is_front)
{
  return is_front ? normal : -normal;
}
