# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes what Blender's Vulkan backend writes before the text of a shader: the declarations of its Program."""

from addon.passes.shader import Program
from tests.support.metal.generator import Stage

KINDS = {"vertex": "vert", "fragment": "frag", "compute": "comp"}
"""The stages as glslang names them."""

_HEAD = """\
#version 450
#extension GL_ARB_shader_draw_parameters : enable
#define GPU_VULKAN
#define gl_VertexID gl_VertexIndex
#define gl_InstanceID (gl_InstanceIndex - gl_BaseInstanceARB)
#define imageFence(image)
"""
_TEXELS = {"FLOAT_2D": "", "INT_2D": "i", "UINT_2D": "u"}
_ACCESS = {"READ": "readonly ", "WRITE": "writeonly ", "READ WRITE": ""}


def text_of(stage: Stage, version: str) -> str:
    """The whole text of a stage by the rules of one of VERSIONS: those of 4.5 make a macro of each push constant."""
    declared = stage.program
    parts = [_HEAD, _textures(stage), _constants(declared, version)]
    between = [*(("smooth", *each) for each in declared.varyings), *(("flat", *each) for each in declared.flat)]
    if stage.kind == "vertex":
        parts += [_located("in", "", *each, slot=i) for i, each in enumerate(declared.inputs)]
    if stage.kind == "fragment":
        parts += [_located("out", "", *each, slot=i) for i, each in enumerate(declared.outputs)]
    if stage.kind == "compute":
        parts += ["layout(local_size_x = {}, local_size_y = {}) in;\n".format(*declared.group)]
    else:
        way = "out" if stage.kind == "vertex" else "in"
        parts += [_located(way, *each, slot=i) for i, each in enumerate(between)]
    return "".join(parts) + "#line 1\n" + stage.text


def _located(way: str, interpolation: str, kind: str, name: str, *, slot: int) -> str:
    return f"layout(location = {slot}) {interpolation} {way} {kind.lower()} {name};\n"


def _textures(stage: Stage) -> str:
    images = stage.program.all_images(stage.as_images)
    samplers = stage.program.all_samplers(stage.as_images)
    lines = [
        f"layout(binding = {i}, {texel.lower()}) uniform restrict {_ACCESS[access]}{_TEXELS[kind]}image2D {name};\n"
        for i, (texel, kind, name, access) in enumerate(images)
    ]
    lines += [
        f"layout(binding = {i}) uniform {_TEXELS[kind]}sampler2D {name};\n"
        for i, (kind, name) in enumerate(samplers, start=len(images))
    ]
    return "".join(lines)


def _constants(declared: Program, version: str) -> str:
    if not declared.constants:
        return ""
    is_old = version == "4.5"
    fields = "".join(f"  {kind.lower()} {'pc_' * is_old}{name};\n" for kind, name in declared.constants)
    block = f"layout(push_constant, std430) uniform constants\n{{\n{fields}}}{' PushConstants' * is_old};\n"
    macros = "".join(f"#define {name} (PushConstants.pc_{name})\n" for _, name in declared.constants)
    return block + macros * is_old
