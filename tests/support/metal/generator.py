# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes what Blender's Metal backend makes of a Program, and has clang check it, without a Mac and without Blender.

Blender puts the text of a shader into a class, whose members are the declarations of the Program. It changes few words of the
text; the rest is left to macros and functions, which blender.hpp declares. library.hpp stands for Metal's standard library.
"""

import re
import shutil
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from addon.passes.shader import Program, prelude, source

VERSIONS = "4.5", "5.1"
"""The versions of Blender that brought new rules: those of 4.5 hold for 5.0, and those of 5.1 for 5.2."""

_HERE = Path(__file__).parent
_TYPES = {"INT": "int", "FLOAT": "float", "MAT4": "float4x4"} | {
    f"{kind}VEC{size}": f"{name}{size}"
    for kind, name in (("", "float"), ("I", "int"), ("U", "uint"))
    for size in (2, 3, 4)
}
_TEXELS = {"FLOAT_2D": "float", "INT_2D": "int", "UINT_2D": "uint"}
_ACCESS = {"READ": "read", "WRITE": "write", "READ WRITE": "read_write"}
_BUILTINS = {
    "vertex": (("int", "gl_VertexID"), ("int", "gl_InstanceID")),
    "fragment": (("float4", "gl_FragCoord"), ("bool", "gl_FrontFacing"), ("int", "gl_PrimitiveID")),
    "compute": (
        *(
            ("uint3", f"gl_{name}")
            for name in ("GlobalInvocationID", "WorkGroupID", "NumWorkGroups", "LocalInvocationID")
        ),
        ("uint", "gl_LocalInvocationIndex"),
    ),
}


@dataclass(frozen=True)
class Stage:
    """A shader of a program: its name in messages, its kind ("vertex", "fragment" or "compute"), and its text in GLSL.

    as_images: the texels of the program are images, not samplers.
    """

    name: str
    kind: str
    text: str
    program: Program
    as_images: bool


def stages_of(name: str, program: Program, as_images: bool) -> list[Stage]:
    """The stages of a program, with the text that shader.load gives to Blender."""
    reads = prelude(as_images)
    texts = {
        "vertex": source(program.vertex) if program.vertex else "",
        "fragment": reads + source(program.fragment, *program.before) if program.fragment else "",
        "compute": reads + source(program.compute, *program.before) if program.compute else "",
    }
    return [Stage(f"{name} {kind}", kind, text, program, as_images) for kind, text in texts.items() if text]


def rewritten(text: str) -> str:
    """The text of a Python shader after Blender's changes on a Mac."""
    text = re.sub(r"/\*.*?\*/", lambda comment: re.sub(r"[^\n]", " ", comment[0]), text, flags=re.DOTALL)
    text = re.sub(r"//[^\n]*", "", text)
    # Constructors of square matrices become functions, which take other matrices, too.
    text = re.sub(r"\bmat([234])(?:x\1)?\(", r"__mat\1x\1(", text)
    # Parameters that are written to become references.
    text = re.sub(r"(out|inout|in|shared)\s+(\w+)\s+(\w+)", r"\1 \2 _\1_sta \3 _\1_end", text)
    # An array that initializes a variable becomes a list in braces.
    return re.sub(r"=\s*(\w+)\s*\[[^]]*\]\s*\(", r"= ARRAY_T(\1) ARRAY_V(", text)


def unit(stages: Iterable[Stage], version: str) -> str:
    """A file of C++ with a class for each stage, by the rules of one of VERSIONS. Errors name the stage."""
    write = _class_up_to_5_0 if version == "4.5" else _class_from_5_1_on
    return '#include "blender.hpp"\n' + "".join(write(stage, f"stage_{i}") for i, stage in enumerate(stages))


def _textures(stage: Stage) -> list[str]:
    samplers = [(_TEXELS[kind], "sample", name) for kind, name in stage.program.all_samplers(stage.as_images)]
    images = [
        (_TEXELS[kind], _ACCESS[access], name) for _, kind, name, access in stage.program.all_images(stage.as_images)
    ]
    return [f"blender_texture<{texel}, access::{access}> {name};" for texel, access, name in samplers + images]


def _interface(stage: Stage) -> tuple[list, list]:
    """The declarations (type, name) that the stage reads, and those that it writes."""
    program = stage.program
    between = [*program.varyings, *program.flat]
    reads = {"vertex": program.inputs, "fragment": between, "compute": ()}[stage.kind]
    writes = {"vertex": between, "fragment": program.outputs, "compute": ()}[stage.kind]
    position = [("float4", "gl_Position")] if stage.kind == "vertex" else []
    return (
        [*((_TYPES[kind], name) for kind, name in reads), *_BUILTINS[stage.kind]],
        [*((_TYPES[kind], name) for kind, name in writes), *position],
    )


def _body(stage: Stage) -> str:
    # Metal reads numbers without a suffix as single precision.
    text = re.sub(
        r"(?<![\w.])(\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)(?![\w.])", r"\1f", rewritten(stage.text), flags=re.I
    )
    return f'#line 1 "{stage.name}"\n{text}\n#line 1 "after {stage.name}"\n'


def _undefined(names: Iterable[str]) -> str:
    return "".join(f"#undef {name}\n" for name in sorted(set(names)))


def _own_macros(stage: Stage) -> list[str]:
    return re.findall(r"^\s*#\s*define\s+(\w+)", stage.text, flags=re.MULTILINE)


def _class_up_to_5_0(stage: Stage, name: str) -> str:
    """Members come first, and can all be written to. Push constants are macros."""
    constants = [(_TYPES[kind], constant) for kind, constant in stage.program.constants]
    reads, writes = _interface(stage)
    block = "".join(f"{kind} {constant}; " for kind, constant in constants)
    members = [f"struct PushConstantBlock {{ {block}}};", "const constant PushConstantBlock *global_uniforms;"]
    members += [f"{kind} {member};" for kind, member in reads + writes] + _textures(stage)
    macros = "".join(f"#define {constant} global_uniforms->{constant}\n" for _, constant in constants)
    names = _own_macros(stage) + [constant for _, constant in constants]
    return f"class {name} {{\npublic:\n" + "\n".join(members) + f"\n{macros}{_body(stage)}}};\n{_undefined(names)}"


def _class_from_5_1_on(stage: Stage, name: str) -> str:
    """Members come last. What a stage only reads is constant."""
    constants = [(_TYPES[kind], constant) for kind, constant in stage.program.constants]
    reads, writes = _interface(stage)
    members = [f"const {kind} &{member};" for kind, member in reads + constants]
    members += [f"thread {kind} &{member};" for kind, member in writes] + _textures(stage)
    return (
        f"struct {name} {{\n{_body(stage)}#undef color\n#undef user\n"
        + "\n".join(members)
        + f"\n{name}();\n}};\n{_undefined(_own_macros(stage))}"
    )


CLANG = shutil.which("clang")
_COMMAND = (
    *("-x", "c++", "-std=c++14", "-fsyntax-only", "-target", "arm64-apple-macos12"),
    *("-ffreestanding", "-nostdinc", "-nostdinc++", "-flax-vector-conversions=none"),
    *("-Wno-everything", "-Werror=vla", "-ferror-limit=0", "-fno-caret-diagnostics", "-fno-color-diagnostics"),
)


def errors(stages: Iterable[Stage], version: str) -> list[str]:
    """What clang reports of these stages by the rules of one of VERSIONS: "stage:line:column: message"."""
    done = subprocess.run(
        [CLANG, *_COMMAND, "-I", str(_HERE), "-"],
        input=unit(stages, version),
        capture_output=True,
        text=True,
        check=False,
    )
    found = [line for line in done.stderr.splitlines() if "error: " in line]
    assert bool(found) == bool(done.returncode), done.stderr
    return [re.sub(r"(?:fatal )?error: ", "", line) for line in found]
