// How samples are counted in the alpha of their sum: hits in whole numbers, misses in fractions that never add up to one.

const float ACCUMULATE_MISS = 1.0 / 256.0;
