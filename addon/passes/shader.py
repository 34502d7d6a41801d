# SPDX-License-Identifier: GPL-3.0-or-later
"""Loads the GLSL files: resolves their includes, declares their interface, compiles them once."""

import functools
import re
from dataclasses import dataclass
from pathlib import Path

import gpu
import numpy as np

SHADERS = Path(__file__).parents[2] / "shaders"
_INCLUDE = re.compile(r'^#include "([^"]+)"\s*$')

_SOFTWARE = "llvmpipe", "softpipe", "lavapipe", "swiftshader", "software"

Declaration = tuple[str, str]  # (type, name), in the words of gpu.types.GPUShaderCreateInfo


@dataclass(frozen=True)
class Program:
    """The interface of a vertex and a fragment shader, or of a compute shader.

    The files themselves hold no declarations: the backend writes those.
    """

    vertex: str = ""
    fragment: str = ""
    compute: str = ""
    inputs: tuple[Declaration, ...] = ()
    varyings: tuple[Declaration, ...] = ()
    samplers: tuple[Declaration, ...] = ()
    constants: tuple[Declaration, ...] = ()
    outputs: tuple[Declaration, ...] = ()
    images: tuple[tuple[str, str, str, str], ...] = ()
    """What a compute shader writes to: (format, type, name, "WRITE" or "READ WRITE")."""
    texels: tuple[tuple[str, str, str], ...] = ()
    """What is read by whole numbers, with texel_at and texel_size: (format, type, name). Images for drivers in software,
    which take twice as long to read a sampler; samplers for all others, since what they cache best are textures."""
    group: tuple[int, int] = (8, 8)
    """A compute shader's workgroup, in texels."""

    def all_samplers(self, as_images: bool) -> list[Declaration]:
        """By slot, with `texels` unless they are images."""
        return [*self.samplers, *(() if as_images else ((kind, name) for _, kind, name in self.texels))]

    def all_images(self, as_images: bool) -> list[tuple[str, str, str, str]]:
        """By slot, with `texels` if they are images."""
        return [*self.images, *(((*texel, "READ") for texel in self.texels) if as_images else ())]


def in_software(renderer: str) -> bool:
    """Whether a renderer of this name draws on the processor."""
    return any(name in renderer.casefold() for name in _SOFTWARE)


@functools.cache
def reads_images() -> bool:
    """Whether a Program's `texels` are images."""
    return in_software(gpu.platform.renderer_get())


def prelude(as_images: bool) -> str:
    """What goes before every source: the ways to read a Program's `texels`."""
    at, size = ("imageLoad(t, p)", "imageSize(t)") if as_images else ("texelFetch(t, p, 0)", "textureSize(t, 0)")
    return f"#define texel_at(t, p) {at}\n#define texel_size(t) {size}\n#line 1\n"


def source(name: str) -> str:
    """The text of the shader file `name` with its includes in place (each once) and #line marks for the compiler."""
    return "\n".join(_lines(name, set()))


def mat4(matrix: np.ndarray) -> list[float]:
    """A matrix of at most 4 x 4 as a MAT4 constant: by columns, and padded since backends disagree on how mat3 are."""
    padded = np.eye(4)
    padded[: matrix.shape[0], : matrix.shape[1]] = matrix
    return padded.T.ravel().tolist()


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


@functools.cache
def load(program: Program) -> gpu.types.GPUShader:
    """Compile `program`, or give the shader compiled before. A compile error goes to the process's standard output."""
    info = gpu.types.GPUShaderCreateInfo()
    for slot, (kind, name) in enumerate(program.inputs):
        info.vertex_in(slot, kind, name)
    if program.varyings:
        interface = gpu.types.GPUStageInterfaceInfo(Path(program.fragment).stem + "_interface")
        for kind, name in program.varyings:
            interface.smooth(kind, name)
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
        info.compute_source(prelude(as_images) + source(program.compute))
    else:
        info.vertex_source(source(program.vertex))
        info.fragment_source(prelude(as_images) + source(program.fragment))
    compiled = gpu.shader.create_from_info(info)
    # Blender knows the shader that is bound by its address. Where this one lies, one that was freed while it was bound may
    # have lain: it would pass for bound, and the other would draw in its place.
    gpu.shader.from_builtin("UNIFORM_COLOR").bind()
    return compiled
