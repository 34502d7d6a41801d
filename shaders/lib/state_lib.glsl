// The states of a texel, as in core/map_types.py.

const float STATE_MARGIN = 1.0 / 255.0;
const float STATE_WRITTEN = 2.0 / 255.0;
const float STATE_MISSED = 3.0 / 255.0;
const float STATE_DEFERRED = 4.0 / 255.0;
const float STATE_FILLED = 5.0 / 255.0;
