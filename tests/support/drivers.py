# SPDX-License-Identifier: GPL-3.0-or-later
"""Does what real drivers do and llvmpipe does not, on any driver; docs/testing.md says what each of these finds."""

import os

import gpu

from addon.passes import shader, target
from tests.support import fast_math

VARIABLE = "IMPRINT_TEST_DRIVER"
"""The environment variable that names one of KINDS for all tests of a process."""
KINDS = {
    "samplers": "textures are read by samplers, and dense meshes are drawn at once, as on all GPUs",
    "images": "textures are read as images, and dense meshes are drawn in pieces, as on software drivers",
    "nan": "new textures hold NaN, where llvmpipe's hold 0",
    "rounding": "a product and a sum are rounded once, and square roots are one unit off in the last place",
}
NAN, IN_FRONT = float("nan"), 0.0
_STORED = {"RGBA32UI": ("UINT_2D", "uvec4(0x7fc00000u)"), "R32I": ("INT_2D", "ivec4(0x7fc00000)")}
_STORED |= {"R16I": ("INT_2D", "ivec4(0x7e00)")}
"""The type and the value of new texels of whole numbers: the bits of NaN."""


def named() -> str:
    """The kind that the environment names."""
    return os.environ.get(VARIABLE, "samplers")


def imitate(kind: str) -> None:
    """From now on, do in this process what one of KINDS says: all but `images` take the ways of a GPU."""
    if kind not in KINDS:
        raise ValueError(f"{VARIABLE} is {kind!r}, and has to be one of {', '.join(KINDS)}")
    shader.in_software = lambda: kind == "images"
    if kind == "nan":
        _fill_new_textures()
    if kind == "rounding":
        source = shader.source
        shader.source = lambda name: fast_math.rounded_otherwise(source(name))


def _fill_new_textures() -> None:
    new_texture, new_offscreen, source = gpu.types.GPUTexture, gpu.types.GPUOffScreen, shader.source

    def texture(size, *, format="RGBA8", data=None, **others):
        if data is not None:
            return new_texture(size, format=format, data=data, **others)
        result = new_texture(size, format=format, **others)
        if format in _STORED:
            _store(result, format)
            return result
        is_depth = format.startswith("DEPTH")
        framebuffer = gpu.types.GPUFrameBuffer(**({"depth_slot": result} if is_depth else {"color_slots": [result]}))
        with framebuffer.bind():
            framebuffer.clear(**({"depth": IN_FRONT} if is_depth else {"color": (0.5 if "8" in format else NAN,) * 4}))
        return result

    def offscreen(width, height, *, format="RGBA8"):
        result = new_offscreen(width, height, format=format)
        with result.bind():
            gpu.state.active_framebuffer_get().clear(color=(NAN,) * 4, depth=IN_FRONT)
        return result

    gpu.types.GPUTexture, gpu.types.GPUOffScreen = texture, offscreen
    values = {f"all {texel}": value for texel, (_, value) in _STORED.items()}
    shader.source = lambda name: (
        f"void main() {{ imageStore(into, ivec2(gl_GlobalInvocationID.xy), {values[name]}); }}"
        if name in values
        else source(name)
    )


def _store(texture: gpu.types.GPUTexture, texel: str) -> None:
    kind, _ = _STORED[texel]
    program = shader.Program(compute=f"all {texel}", images=((texel, kind, "into", "WRITE"),))
    target.dispatch_groups(program, (-(-texture.width // 8), -(-texture.height // 8)), into=texture)
