# SPDX-License-Identifier: GPL-3.0-or-later
"""Loads the GLSL files: resolves their includes, declares their interface, compiles them once."""

import functools
import re
from dataclasses import dataclass
from pathlib import Path

import gpu

SHADERS = Path(__file__).parents[2] / "shaders"
_INCLUDE = re.compile(r'^#include "([^"]+)"\s*$')

Declaration = tuple[str, str]  # (type, name), in the words of gpu.types.GPUShaderCreateInfo


@dataclass(frozen=True)
class Program:
    """The interface of one pair of shader files, which themselves hold no declarations: the backend writes those."""

    vertex: str
    fragment: str
    inputs: tuple[Declaration, ...] = ()
    varyings: tuple[Declaration, ...] = ()
    samplers: tuple[Declaration, ...] = ()
    constants: tuple[Declaration, ...] = ()
    outputs: tuple[Declaration, ...] = ()


def source(name: str) -> str:
    """The text of the shader file `name` with its includes in place (each once) and #line marks for the compiler."""
    return "\n".join(_lines(name, set()))


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
    for slot, (kind, name) in enumerate(program.samplers):
        info.sampler(slot, kind, name)
    for kind, name in program.constants:
        info.push_constant(kind, name)
    for slot, (kind, name) in enumerate(program.outputs):
        info.fragment_out(slot, kind, name)
    info.vertex_source(source(program.vertex))
    info.fragment_source(source(program.fragment))
    return gpu.shader.create_from_info(info)
