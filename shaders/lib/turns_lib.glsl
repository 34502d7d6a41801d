// Counts the turns of loops that walk trees. Some drivers, as llvmpipe, end loops in silence: after 65,535 turns of all loops of the
// lanes that run together, 8 or 16. Others take a GPU that is busy for long for one that hangs.

// The most turns of a lane in a dispatch. Where eight lanes take their turns one after another, these are fewer than 32,768.
const int TURNS_MOST = 4000;
// What a visit of triangles counts beside the turns of its loops: those in which the loops end.
const int TURNS_OF_VISIT = 3;
