# SPDX-License-Identifier: GPL-3.0-or-later
"""Does what real drivers do and llvmpipe does not, on any driver; docs/testing.md says what each of these finds."""

import os

import gpu

from addon.passes import allocation, shader
from tests.support import fast_math

VARIABLE = "IMPRINT_TEST_DRIVER"
"""The environment variable that names one of KINDS for all tests of a process."""
KINDS = {
    "samplers": "textures are read by samplers, and dense meshes are drawn at once, as on all GPUs",
    "images": "textures are read as images, and dense meshes are drawn in pieces, as on software drivers",
    "nan": "new textures hold NaN, where llvmpipe's hold 0",
    "rounding": "a product and a sum are rounded once, and square roots are one unit off in the last place",
}
_in_software = shader.in_software
"""What it says before a test imitates another driver."""
NAN, IN_FRONT = float("nan"), 0.0
_WHOLE = {"RGBA32UI": ("UINT", 0x7FC00000), "R32I": ("INT", 0x7FC00000), "R16I": ("INT", 0x7E00)}
"""The type and the value of new texels of whole numbers: the bits of NaN."""


def named() -> str:
    """The kind that the environment names."""
    return os.environ.get(VARIABLE, "samplers")


def on_hardware() -> bool:
    """Whether a GPU draws, rather than Mesa's llvmpipe.

    GPUs interpolate between corners that they have rounded to 1/256 texel, llvmpipe between the corners as they are. So what
    is drawn over a triangle is that of a place up to 1/512 texel beside.
    """
    return not _in_software()


def limit(in_software: float, on_gpus: float) -> float:
    """The limit of a test on the driver at hand: on_gpus where a GPU draws."""
    return on_gpus if on_hardware() else in_software


def imitate(kind: str) -> None:
    """From now on, do in this process what one of KINDS says: all but `images` take the ways of a GPU."""
    if kind not in KINDS:
        raise ValueError(f"{VARIABLE} is {kind!r}, and has to be one of {', '.join(KINDS)}")
    shader.in_software = lambda: kind == "images"
    if kind == "nan":
        _fill_new_textures()
    if kind == "rounding":
        source = shader.source
        shader.source = lambda *names: fast_math.rounded_otherwise(source(*names))


def _fill_new_textures() -> None:
    new_texture, new_offscreen = allocation.texture, allocation.offscreen

    def texture(size, texel, values=None):
        made = new_texture(size, texel, values)
        if values is None:
            of_floats = IN_FRONT if texel.startswith("DEPTH") else 0.5 if texel.endswith("8") else NAN
            kind, value = _WHOLE.get(texel, ("FLOAT", of_floats))
            made.clear(format=kind, value=(value,) * 4)
        return made

    def offscreen(size, texel):
        made = new_offscreen(size, texel)
        with made.bind():
            gpu.state.active_framebuffer_get().clear(color=(NAN,) * 4, depth=IN_FRONT)
        return made

    allocation.texture, allocation.offscreen = texture, offscreen
