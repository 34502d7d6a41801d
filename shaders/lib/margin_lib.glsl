// Shared by the searches for the nearest written texel: the value for none in reach.

const int MARGIN_NONE = 32767;
