// How far each ray went; -1 where it hit nothing.

void main()
{
  uvec4 hit = texelFetch(hits, ivec2(gl_FragCoord.xy), 0);
  distance_out = vec4(hit.x != 0u ? uintBitsToFloat(hit.w) : -1.0);
}
