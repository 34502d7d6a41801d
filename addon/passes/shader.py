# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader programs: declares their interfaces as data, loads their files with includes resolved, compiles and caches them."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.progress import startup
from . import blender_gpu as gpu

SHADERS = Path(__file__).parents[2] / "shaders"
_INCLUDE = re.compile(r'^#include "([^"]+)"\s*$')

_SOFTWARE = "llvmpipe", "softpipe", "lavapipe", "swiftshader", "software"

Declaration = tuple[str, str]  # (type, name), with the types of gpu.types.GPUShaderCreateInfo


@dataclass(frozen=True)
class Program:
    """The interface of a vertex and a fragment shader, or of a compute shader.

    The shader files contain no declarations: Blender's backend writes them.
    """

    vertex: str = ""
    fragment: str = ""
    compute: str = ""
    library: str = ""
    """A library that comes before the fragment or the compute shader, which asks by #ifdef whether it is there."""
    inputs: tuple[Declaration, ...] = ()
    """Attributes of vertices."""
    varyings: tuple[Declaration, ...] = ()
    """From vertex to fragment, interpolated."""
    flat: tuple[Declaration, ...] = ()
    """From vertex to fragment, not interpolated: whole numbers that all corners of a triangle share."""
    samplers: tuple[Declaration, ...] = ()
    """Textures to sample or fetch."""
    constants: tuple[Declaration, ...] = ()
    """Push constants."""
    outputs: tuple[Declaration, ...] = ()
    """Colors of the fragment shader."""
    images: tuple[tuple[str, str, str, str], ...] = ()
    """The images that a compute shader writes: (format, type, name, "WRITE" or "READ WRITE")."""
    texels: tuple[tuple[str, str, str], ...] = ()
    """Textures read at integer coordinates, with texel_at and texel_size: (format, type, name). Software drivers read them
    as images, since a sampler takes them twice as long; other drivers read them as samplers, which their caches suit."""
    group: tuple[int, int] = (8, 8)
    """A compute shader's workgroup, in texels."""
    cost: float = 0.0
    """How many rays of a bake take as long as a texel, at most, as core.progress counts them; 0 for so few that a GPU draws the
    largest map at once."""

    @property
    def before(self) -> tuple[str, ...]:
        """`library`, if there is one."""
        return (self.library,) if self.library else ()

    def all_samplers(self, as_images: bool) -> list[Declaration]:
        """The samplers by slot, including `texels` unless they are images."""
        return [*self.samplers, *(() if as_images else ((kind, name) for _, kind, name in self.texels))]

    def all_images(self, as_images: bool) -> list[tuple[str, str, str, str]]:
        """The images by slot, including `texels` if they are images."""
        return [*self.images, *(((*texel, "READ") for texel in self.texels) if as_images else ())]


def prelude(as_images: bool) -> str:
    """The text before every shader source: the macros that read a Program's `texels`."""
    at, size = ("imageLoad(t, p)", "imageSize(t)") if as_images else ("texelFetch(t, p, 0)", "textureSize(t, 0)")
    return f"#define texel_at(t, p) {at}\n#define texel_size(t) {size}\n#line 1\n"


def source(name: str, *before: str) -> str:
    """The text of the shader file `name`, with each include resolved once, and #line marks for the compiler.

    before: the files that come before it.
    """
    seen: set[str] = set()
    lines = [line for file in before for line in (*_lines(file, seen), "#line 1")]
    return "\n".join([*lines, *_lines(name, seen)])


def _lines(name: str, seen: set[str]) -> list[str]:
    seen.add(name)
    lines = []
    for number, line in enumerate((SHADERS / name).read_text(encoding="utf-8").splitlines(), start=1):
        include = _INCLUDE.match(line)
        if include is None:
            lines.append(line)
        elif include[1] not in seen:
            lines += [*_lines(include[1], seen), f"#line {number + 1}"]
    return lines


def is_software(renderer: str) -> bool:
    """Whether the renderer of this name runs on the CPU."""
    return any(name in renderer.casefold() for name in _SOFTWARE)


@functools.cache
def in_software() -> bool:
    """Whether a program on the CPU draws."""
    return is_software(gpu.platform.renderer_get())


def reads_images() -> bool:
    """Whether a Program's `texels` are images."""
    return in_software()


def mat4(matrix: np.ndarray) -> list[float]:
    """A matrix of at most 4 x 4 as a MAT4 constant, in column order. Backends differ in how they pad MAT3, so pad it here."""
    padded = np.eye(4)
    padded[: matrix.shape[0], : matrix.shape[1]] = matrix
    return padded.T.ravel().tolist()


@functools.cache
def load(program: Program) -> gpu.types.GPUShader:
    """Compile `program`, or return the cached shader. Blender prints compile errors to the process's standard output."""
    info = gpu.types.GPUShaderCreateInfo()
    for slot, (kind, name) in enumerate(program.inputs):
        info.vertex_in(slot, kind, name)
    if program.varyings or program.flat:
        interface = gpu.types.GPUStageInterfaceInfo(Path(program.fragment).stem + "_interface")
        for kind, name in program.varyings:
            interface.smooth(kind, name)
        for kind, name in program.flat:
            interface.flat(kind, name)
        info.vertex_out(interface)
    as_images = reads_images()
    for slot, (kind, name) in enumerate(program.all_samplers(as_images)):
        info.sampler(slot, kind, name)
    for kind, name in program.constants:
        info.push_constant(kind, name)
    for slot, (kind, name) in enumerate(program.outputs):
        info.fragment_out(slot, kind, name)
    for slot, (texel, kind, name, access) in enumerate(program.all_images(as_images)):
        info.image(slot, texel, kind, name, qualifiers=set(access.split()))
    if program.compute:
        info.local_group_size(*program.group)
        info.compute_source(prelude(as_images) + source(program.compute, *program.before))
    else:
        info.vertex_source(source(program.vertex))
        info.fragment_source(prelude(as_images) + source(program.fragment, *program.before))
    with startup.spent("shaders"):
        compiled = gpu.shader.create_from_info(info)
    # Blender identifies the bound shader by its address. A shader freed while it was bound may have had this address: then
    # Blender would take the new one for bound, and draw with the wrong one.
    gpu.shader.from_builtin("UNIFORM_COLOR").bind()
    return compiled
