// The depth test comes before the shader, which also discards: some drivers would run it for texels that the test leaves out.
// Nothing else changes where depth is not written.
#ifndef GPU_METAL
layout(early_fragment_tests) in;
#endif
