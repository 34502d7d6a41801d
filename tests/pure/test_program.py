# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the shader files and the declarations of the passes, without a GPU."""

import re

import pytest

from addon.passes import shader
from tests.support import programs

PROGRAMS = programs.find_all()


def files_of(declared):
    """The shader files of a program."""
    return [name for name in (declared.vertex, declared.fragment, declared.compute) if name]


def test_every_file_is_used_and_named_for_its_stage():
    used = {name for each in PROGRAMS.values() for name in files_of(each)}
    files = {path.relative_to(shader.SHADERS).as_posix(): path for path in shader.SHADERS.rglob("*.glsl")}
    for name, path in files.items():
        stage = path.stem.rsplit("_", 1)[1]
        text = path.read_text(encoding="utf-8")
        assert text.count("void main()") == (0 if stage == "lib" else 1), name
        if stage == "lib":
            assert any(f'#include "{name}"' in other.read_text(encoding="utf-8") for other in files.values())
        else:
            assert stage in {"vert", "frag", "comp"}
            assert name in used


def test_includes_are_resolved_once_and_lines_keep_their_numbers(tmp_path, monkeypatch):
    (tmp_path / "a_lib.glsl").write_text("float a_one() { return 1.0; }\n")
    (tmp_path / "b_lib.glsl").write_text('#include "a_lib.glsl"\nfloat b_one() { return a_one(); }\n')
    (tmp_path / "c_frag.glsl").write_text('#include "a_lib.glsl"\n#include "b_lib.glsl"\nvoid main() {}\n')
    monkeypatch.setattr(shader, "SHADERS", tmp_path)
    text = shader.source("c_frag.glsl")
    assert text.count("float a_one") == 1
    assert text.count("float b_one") == 1
    assert "#include" not in text
    assert text.splitlines()[text.splitlines().index("void main() {}") - 1] == "#line 3"


@pytest.mark.parametrize("declared", PROGRAMS.values(), ids=PROGRAMS)
def test_shaders_use_all_declared_names(declared):
    """Some drivers remove unused names, and setting them is an error."""
    text = "\n".join(map(shader.source, files_of(declared)))
    words = set(re.findall(r"\w+", text))
    varyings = declared.varyings + declared.flat
    kinds = (declared.inputs, varyings, declared.samplers, declared.constants, declared.outputs)
    names = [name for kind in kinds for _, name in kind]
    names += [name for _, _, name in declared.texels] + [name for _, _, name, _ in declared.images]
    assert names
    assert len(set(names)) == len(names)
    assert [name for name in names if name not in words] == []


BYTES = {
    "INT": (4, 4),
    "FLOAT": (4, 4),
    "VEC2": (8, 8),
    "VEC3": (12, 16),
    "VEC4": (16, 16),
    "IVEC4": (16, 16),
    "MAT4": (64, 16),
}
"""The size of a constant, and the number of bytes of which its place is a multiple."""
MOST_CONSTANTS = 128
"""The bytes of push constants that every Vulkan driver supports."""


@pytest.mark.parametrize("declared", PROGRAMS.values(), ids=PROGRAMS)
def test_constants_fit_on_every_vulkan_driver(declared):
    end = 0
    for kind, _ in declared.constants:
        size, multiple = BYTES[kind]
        end = -(-end // multiple) * multiple + size
    assert end <= MOST_CONSTANTS


@pytest.mark.parametrize("path", sorted(shader.SHADERS.rglob("*_lib.glsl")), ids=lambda path: path.stem)
def test_names_of_a_library_start_with_its_own(path):
    text = path.read_text(encoding="utf-8")
    defined = re.findall(r"^(?:const )?(?:int|float|[iu]?vec\d|mat\d) (\w+)", text, re.MULTILINE)
    own = path.stem.removesuffix("_lib")
    assert [name for name in defined if not name.lower().startswith(f"{own}_")] == []


@pytest.mark.parametrize(
    ("renderer", "expected"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("Google SwiftShader", True),
        ("NVIDIA H200/PCIe/SSE2", False),
        ("AMD Radeon RX 7900 XTX (radeonsi, navi31, LLVM 17.0.6)", False),
        ("Intel(R) UHD Graphics 620", False),
        ("Apple M3 Max", False),
    ],
)
def test_software_renderers_are_recognized(renderer, expected):
    assert shader.is_software(renderer) == expected
