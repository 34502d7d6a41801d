# SPDX-License-Identifier: GPL-3.0-or-later
"""The shader files and their loader."""

import pytest

from addon import passes
from addon.passes import (
    cast,
    deviation,
    faces,
    flatten,
    gbuffer,
    lit,
    margin,
    overlap,
    picture,
    points,
    relief,
    resolve,
    samples,
    seams,
    shader,
    shell,
    tangent,
)

PROGRAMS = [
    flatten.PROGRAM,
    tangent.PROGRAM,
    margin.ROWS,
    margin.COLUMNS,
    resolve.PROGRAM,
    seams.BORDERS,
    seams.ACROSS,
    gbuffer.PROGRAM,
    cast.TRACE,
    cast.LOOKUP,
    cast.DISTANCE,
    cast.POINTS,
    points.PROGRAM,
    relief.PROGRAM,
    shell.PROGRAM,
    lit.MAP,
    lit.BARE,
    deviation.MEASURE,
    deviation.RAMP,
    deviation.LEGEND,
    overlap.PROGRAM,
    faces.PROGRAM,
    picture.PROGRAM,
    samples.ADD,
    samples.AVERAGE,
]


def test_every_file_is_used_and_named_for_its_stage():
    used = {name for program in PROGRAMS for name in (program.vertex, program.fragment, program.compute)}
    for path in shader.SHADERS.iterdir():
        stage = path.stem.rsplit("_", 1)[1]
        text = path.read_text(encoding="utf-8")
        assert text.count("void main()") == (0 if stage == "lib" else 1), path.name
        if stage == "lib":
            assert any(
                f'#include "{path.name}"' in other.read_text(encoding="utf-8") for other in shader.SHADERS.iterdir()
            )
        else:
            assert stage in {"vert", "frag", "comp"}
            assert path.name in used, path.name


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


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.fragment or program.compute)
def test_every_program_compiles_once(program):
    assert shader.load(program) is shader.load(program)


@pytest.mark.usefixtures("gpu_context")
def test_free_leaves_no_gpu_object():
    shader.load(flatten.PROGRAM)
    passes.free()
    assert shader.load.cache_info().currsize == 0
