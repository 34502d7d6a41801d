// Shared by the searches for the nearest written texel: the value for none in reach, and the texels of a word of bits.

const int MARGIN_NONE = 32767;
const int MARGIN_WORD = 32;
