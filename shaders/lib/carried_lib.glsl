// What is left when a lane has no turns any more, and goes on in the next dispatch of passes/unfinished.py. The image `carried` has
// at 0, 0 whether there are any such lanes, and in the rows above what they need to go on. The constant `first_row` is a multiple
// of 8 plus the stage. CARRIED_GOES_ON says whether the program has all stages, or only the first one: software runs all branches
// of a shader.
#include "lib/turns_lib.glsl"

// Stages: all texels; those that were left, from their beginning; those that were left again, from where they were.
const int CARRIED_ALL = 0;
const int CARRIED_BEGIN = 1;
const int CARRIED_ON = 2;

int carried_stage()
{
  return CARRIED_GOES_ON ? first_row & 7 : CARRIED_ALL;
}

int carried_row()
{
  return first_row & ~7;
}

// The place of part `number` of the `parts` texels that each lane has.
ivec2 carried_place(int number, int parts)
{
  ivec2 lane = ivec2(gl_GlobalInvocationID.xy);
  return ivec2(lane.x, lane.y * parts + number + 1);
}

void carried_note()
{
  imageStore(carried, ivec2(0), uvec4(1u));
}
