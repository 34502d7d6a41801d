// The low mesh, laid flat, with what spans its tangent space.
#include "lib/uvspace_lib.glsl"

void main()
{
  gl_Position = uvspace_position(uv, uv_to_clip);
  v_normal = normal;
  v_tangent = tangent;
}
