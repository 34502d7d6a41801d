// Packets: the rays of a block of texels, which pass the tree together first. The texture `packets` has what each packet can hit,
// in two texels: up to eight nodes of triangles, in order, then zeros; or one node to start the walk from, without triangles.

// Texels along each side of a block.
const int PACKET_SIDE = 4;
// The bits of an entry below the number of its node: one for each of its triangles.
const int PACKET_BITS = 4;

// The first of a packet's two texels.
ivec2 packet_place(ivec2 block)
{
  return ivec2(block.x * 2, block.y);
}

uint packet_entry(int node, uint triangles)
{
  return (uint(node + 1) << PACKET_BITS) | triangles;
}

int packet_node(uint entry)
{
  return int(entry >> PACKET_BITS) - 1;
}

uint packet_triangles(uint entry)
{
  return entry & ((1u << PACKET_BITS) - 1u);
}
