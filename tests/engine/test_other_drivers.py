# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs tests of the passes and of bakes once more, as drivers that differ from this one: tests/support/drivers.py."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from addon.passes import allocation, shader, target
from tests.support import drivers

ROOT = Path(__file__).parents[2]
FILES = {
    "images": [
        "passes/test_owned_hits.py",
        "passes/test_openness.py",
        "passes/test_image_look_up.py",
        "passes/test_turned_normals.py",
        "engine/test_dense_meshes.py",
        "engine/test_flat_and_rays.py",
        "engine/test_samples.py",
    ],
    "nan": [
        "passes",
        "engine/test_flat_and_rays.py",
        "engine/test_margins.py",
        "engine/test_material_maps.py",
        "engine/test_own_normals.py",
        "engine/test_ray_maps.py",
        "engine/test_samples.py",
    ],
    "rounding": ["passes", "engine/test_closed_form.py", "engine/test_samples.py"],
}


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("texel", [texel for texel in allocation.TEXEL_BYTES if not texel.startswith("DEPTH")])
def test_new_memory_is_not_zero(monkeypatch, texel):
    kind = {"UI": "UINT_2D", "I": "INT_2D"}.get(texel.lstrip("RGBA0123456789"), "FLOAT_2D")
    shown = shader.Program(
        vertex="lib/fullscreen_vert.glsl",
        fragment=f"show {texel}",
        inputs=(("VEC2", "position"),),
        samplers=((kind, "values"),),
        outputs=(("VEC4", "out_value"),),
    )
    source, into = shader.source, target.Target(4, 3, ("RGBA32F",))
    text = "void main() { out_value = vec4(texelFetch(values, ivec2(gl_FragCoord.xy), 0)); }"
    monkeypatch.setattr(shader, "source", lambda name: text if name == shown.fragment else source(name))
    for module, name in (allocation, "texture"), (allocation, "offscreen"), (shader, "in_software"):
        monkeypatch.setattr(module, name, getattr(module, name))  # so that the end of the test restores it
    drivers.imitate("nan")
    target.fill(into, shown, values=allocation.texture((4, 3), texel))
    assert (into.texels()[..., 0] != 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_other_drivers_pass_the_same_tests(kind):
    paths = [str(ROOT / "tests" / name) for name in FILES[kind]]
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow", *paths]
    done = subprocess.run(
        words, cwd=ROOT, env={**os.environ, drivers.VARIABLE: kind}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-4000:]
