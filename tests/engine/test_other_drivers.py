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
        "engine/test_cutouts.py",
        "engine/test_dense_meshes.py",
        "engine/test_flat_and_rays.py",
        "engine/test_samples.py",
    ],
    "nan": [
        "passes/test_image_look_up.py",
        "passes/test_margin_search.py",
        "passes/test_target.py",
        "engine/test_cutouts.py",
        "engine/test_margins.py",
        "engine/test_own_normals.py",
        "engine/test_samples.py",
    ],
    "rounding": [
        "passes/test_drawn_rays.py",
        "passes/test_owned_hits.py",
        "passes/test_openness.py",
        "passes/test_turned_normals.py",
        "engine/test_cutouts.py",
        "engine/test_flat_and_rays.py",
    ],
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


ZINK = {"GALLIUM_DRIVER": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"}
"""The environment in which Mesa's OpenGL draws by Vulkan: later than it is called, as drivers of GPUs do."""
ON_ZINK = ["passes/test_target.py"]


@pytest.mark.slow
def test_an_opengl_that_draws_later_passes_the_same_tests():
    environment = {**os.environ, **ZINK}
    words = [sys.executable, "-c", "import bpy, gpu; gpu.init(); print(gpu.platform.renderer_get())"]
    found = subprocess.run(words, env=environment, capture_output=True, text=True, check=False).stdout
    if "zink" not in found:
        reason = "no zink, which needs lavapipe"
        if os.environ.get("CI") == "true":
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    run(ON_ZINK, environment)


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_other_drivers_pass_the_same_tests(kind):
    run(FILES[kind], {**os.environ, drivers.VARIABLE: kind})


def run(files, environment):
    paths = [str(ROOT / "tests" / name) for name in files]
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow", *paths]
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
