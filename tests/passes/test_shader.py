# SPDX-License-Identifier: GPL-3.0-or-later
"""The shader files and their loader."""

import numpy as np
import pytest

from addon import passes
from addon.passes import shader
from addon.passes.audit import overlap, triangle_ids
from addon.passes.bake import cast, flatten, gbuffer, points, samples, surface_values, tangent
from addon.passes.margin import nearest_texel, resolve, seam_fill
from addon.passes.view import cage_shell, deviation, lit, preview_picture
from tests.support import zoo
from tests.support.maps import bake

PROGRAMS = [
    flatten.PROGRAM,
    tangent.PROGRAM,
    nearest_texel.ROWS,
    nearest_texel.COLUMNS,
    resolve.PROGRAM,
    seam_fill.BORDERS,
    seam_fill.ACROSS,
    gbuffer.PROGRAM,
    cast.TRACE,
    cast.LOOKUP,
    cast.DISTANCE,
    cast.POINTS,
    points.PROGRAM,
    surface_values.PROGRAM,
    cage_shell.PROGRAM,
    lit.MAP,
    lit.BARE,
    deviation.MEASURE,
    deviation.RAMP,
    deviation.LEGEND,
    overlap.PROGRAM,
    triangle_ids.PROGRAM,
    preview_picture.PROGRAM,
    samples.ADD,
    samples.AVERAGE,
]


def test_every_file_is_used_and_named_for_its_stage():
    used = {name for program in PROGRAMS for name in (program.vertex, program.fragment, program.compute)}
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


@pytest.fixture(params=[True, False], ids=["images", "samplers"])
def reading(request, monkeypatch):
    """Programs read their texels as drivers in software want it, and as others do."""
    shader.load.cache_clear()
    monkeypatch.setattr(shader, "reads_images", lambda: request.param)
    yield
    shader.load.cache_clear()


@pytest.mark.usefixtures("gpu_context", "reading")
@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.fragment or program.compute)
def test_every_program_compiles_once(program):
    assert shader.load(program) is shader.load(program)


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_samplers_and_images_make_the_same_map(method, monkeypatch):
    """Seams, margin, tangents and samples included."""
    low, high = zoo.sphere("low", 8), zoo.sphere("high", 32)
    high.scale.z = 1.2
    rays = {"extrusion": 0.3, "max_distance": 0.6} if method == "CAST" else {}
    maps = []
    for as_images in (True, False):
        shader.load.cache_clear()
        monkeypatch.setattr(shader, "reads_images", lambda as_images=as_images: as_images)
        maps.append(bake(low, high, method=method, samples=4, margin=4, margin_type="ADJACENT_FACES", **rays))
    shader.load.cache_clear()
    assert len(np.unique(maps[0])) > 1000
    assert np.array_equal(*maps)


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
def test_what_draws_in_software(renderer, expected):
    assert shader.in_software(renderer) == expected


@pytest.mark.usefixtures("gpu_context")
def test_free_leaves_no_gpu_object():
    shader.load(flatten.PROGRAM)
    passes.free()
    assert shader.load.cache_info().currsize == 0
