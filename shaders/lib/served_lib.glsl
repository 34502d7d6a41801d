// The texel that a lane works on, where a pass runs only on some blocks of a map. `blocks` lists them by column and row;
// addon/passes/surface_tables.py finds them. A workgroup is a square of 8 x 8 texels.

const int SERVED_BLOCK = 32;

ivec2 served_texel()
{
  ivec2 group = ivec2(gl_WorkGroupID.xy);
  ivec2 block = ivec2(texelFetch(blocks, texture_place(group.y), 0).xy);
  return block * SERVED_BLOCK + ivec2(group.x % 4, group.x / 4) * 8 + ivec2(gl_LocalInvocationID.xy);
}
