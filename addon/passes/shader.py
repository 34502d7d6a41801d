# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiles shader programs, and caches them."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from ..core.progress import startup
from . import blender_gpu as gpu
from .program import Program, prelude, source
from .program import in_software as is_software


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
        info.compute_source(prelude(as_images) + source(program.compute))
    else:
        info.vertex_source(source(program.vertex))
        info.fragment_source(prelude(as_images) + source(program.fragment))
    with startup.spent("shaders"):
        compiled = gpu.shader.create_from_info(info)
    # Blender identifies the bound shader by its address. A shader freed while it was bound may have had this address: then
    # Blender would take the new one for bound, and draw with the wrong one.
    gpu.shader.from_builtin("UNIFORM_COLOR").bind()
    return compiled
