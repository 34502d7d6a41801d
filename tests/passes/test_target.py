# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that GPU state left by scripts, and rows of other passes, do not change what targets get."""

import gpu
import numpy as np
import pytest

from addon.core import udim
from addon.passes import high_in_uv, mesh_upload, target

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (16, 12)


def square(into):
    """Draw a square with a tilted normal over all of `into`. Returns the texels."""
    mesh = mesh_upload.upload(
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        uv=np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32),
        normal=np.tile(np.float32((0.6, 0.0, 0.8)), (4, 1)),
    )
    high_in_uv.draw_normals(
        into, [(mesh, np.eye(3)), (mesh, np.eye(3))], udim.uv_to_clip(1001)
    )  # twice, to detect additive blending
    texels = np.empty((into.height, into.width, 4), np.float32)
    into.read(texels)
    return texels


def is_whole(texels):
    return np.allclose(texels, (0.6, 0.0, 0.8, 1.0), atol=1e-6)


@pytest.mark.parametrize(
    ("switch", "value", "usual"),
    [
        ("blend_set", ("ADDITIVE",), ("NONE",)),
        ("blend_set", ("ALPHA_PREMULT",), ("NONE",)),
        ("color_mask_set", (False, True, False, False), (True, True, True, True)),
        ("depth_test_set", ("EQUAL",), ("NONE",)),
    ],
)
@pytest.mark.parametrize("kind", [target.Target, target.Offscreen])
def test_gpu_state_left_by_a_script_does_not_matter(kind, switch, value, usual):
    getattr(gpu.state, switch)(*value)
    try:
        assert is_whole(square(kind(*SIZE, ("RGBA32F",))))
    finally:
        getattr(gpu.state, switch)(*usual)


def test_the_blend_mode_is_restored():
    gpu.state.blend_set("ADDITIVE")
    try:
        square(target.Target(*SIZE, ("RGBA32F",)))
        assert gpu.state.blend_get() == "ADDITIVE"
    finally:
        gpu.state.blend_set("NONE")


@pytest.mark.parametrize("kind", [target.Target, target.Offscreen])
def test_drawing_some_rows_does_not_limit_later_drawing(kind):
    into = kind(*SIZE, ("RGBA32F",))
    with target.drawing(into, range(2, 5)):
        pass
    assert is_whole(square(into))
    assert is_whole(square(kind(*SIZE, ("RGBA32F",))))


def test_no_framebuffer_is_bound_a_second_time():
    """On OpenGL a framebuffer belongs to the window in which it was first bound; the next block may run in another one."""
    into = target.Target(4, 4, ("RGBA32F", "DEPTH_COMPONENT32F"))
    bound = []
    for value in (0.25, 0.75):
        with into.bound() as framebuffer:
            framebuffer.clear(color=(value,) * 4, depth=1.0)
            bound.append(framebuffer)
            assert into.framebuffer is framebuffer
    assert bound[0] is not bound[1]
    texels = np.empty((4, 4, 4), np.float32)
    into.read(texels)
    assert (texels == 0.75).all()
    assert into.framebuffer not in bound
