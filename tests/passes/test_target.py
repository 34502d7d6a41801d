# SPDX-License-Identifier: GPL-3.0-or-later
"""Targets: what a script has left switched on, and rows of another pass, leave no trace in what is drawn."""

import gpu
import numpy as np
import pytest

from addon.core import udim
from addon.passes import mesh_upload, target
from addon.passes.bake import flatten

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (16, 12)


def square(into):
    """Draw a square over the whole of `into`, with a normal that leans; returns the texels."""
    mesh = mesh_upload.upload(
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        uv=np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32),
        normal=np.tile(np.float32((0.6, 0.0, 0.8)), (4, 1)),
    )
    flatten.draw(into, [(mesh, np.eye(3)), (mesh, np.eye(3))], udim.uv_to_clip(1001))  # twice: what is added shows
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
def test_what_a_script_has_left_on_does_not_count(kind, switch, value, usual):
    getattr(gpu.state, switch)(*value)
    try:
        assert is_whole(square(kind(*SIZE, ("RGBA32F",))))
    finally:
        getattr(gpu.state, switch)(*usual)


def test_a_blend_comes_back():
    gpu.state.blend_set("ADDITIVE")
    try:
        square(target.Target(*SIZE, ("RGBA32F",)))
        assert gpu.state.blend_get() == "ADDITIVE"
    finally:
        gpu.state.blend_set("NONE")


@pytest.mark.parametrize("kind", [target.Target, target.Offscreen])
def test_rows_that_were_drawn_alone_bind_nobody_later(kind):
    into = kind(*SIZE, ("RGBA32F",))
    with target.drawing(into, range(2, 5)):
        pass
    assert is_whole(square(into))
    assert is_whole(square(kind(*SIZE, ("RGBA32F",))))


def test_no_framebuffer_is_bound_a_second_time():
    """On OpenGL one belongs to the window in which it was first bound, and the next block may run in another window."""
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
