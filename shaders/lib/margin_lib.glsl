// What the searches for the nearest written texel share.

const int MARGIN_NONE = 32767;
