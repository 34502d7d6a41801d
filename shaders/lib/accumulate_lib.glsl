// The alpha of a sum counts samples: 1 for each hit, and for each miss a fraction so small that they never add up to 1.

const float ACCUMULATE_MISS = 1.0 / 256.0;
