// Writes the point on the high surface that each ray hit, and the numbers of its object and its material.
#include "lib/texture_lib.glsl"
#include "lib/hit_lib.glsl"

void main()
{
  uvec4 hit = texelFetch(hits, ivec2(gl_FragCoord.xy), 0);
  if (!hit_missed(hit)) {
    int triangle = hit_triangle(hit);
    vec2 weights = hit_weights(hit);
    vec3 corner = texelFetch(corners, texture_place(triangle * 3), 0).xyz;
    vec3 edge1 = texelFetch(corners, texture_place(triangle * 3 + 1), 0).xyz - corner;
    vec3 edge2 = texelFetch(corners, texture_place(triangle * 3 + 2), 0).xyz - corner;
    vec3 point = corner + edge1 * weights.x + edge2 * weights.y;
    point_out = vec4(point, 1.0);
    labels_out = vec4(texelFetch(labels, texture_place(triangle), 0).xy, 0.0, 1.0);
  }
  else {
    discard;  // what is there stays: nothing, or a point on another part
  }
}
