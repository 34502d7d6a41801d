// The texel that a lane of a compute shader works on. The workgroups are squares of 8 x 8.

// Eight consecutive lanes are a block of 4 x 2, so that they run together: rays of close texels take similar paths.
ivec2 block_texel(int row)
{
  int lane = int(gl_LocalInvocationIndex);
  ivec2 inner = ivec2((lane & 3) | ((lane >> 1) & 4), ((lane >> 2) & 1) | ((lane >> 3) & 6));
  return ivec2(gl_WorkGroupID.xy) * 8 + inner + ivec2(0, row);
}
