// What the margin's two searches share.

const int MARGIN_NONE = 32767;
