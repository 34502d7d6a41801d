// Writes the distance that each ray traveled, -1 for a miss.

void main()
{
  uvec4 hit = texelFetch(hits, ivec2(gl_FragCoord.xy), 0);
  distance_out = vec4(hit.x != 0u ? uintBitsToFloat(hit.w) : -1.0);
}
