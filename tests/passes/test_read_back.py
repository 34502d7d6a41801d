# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that what compute shaders store is not read through a framebuffer, nor mixed with drawing into the same texture.

On OpenGL Blender has no barrier between them, and a GPU may show what was there before. Software drivers always show it right.
"""

import numpy as np
import pytest

from addon.passes import high_in_uv, surface_tables, target
from tests.support.seen_surface import SeenSurface, grid, read, texture

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def no_compute(monkeypatch):
    """Make each compute shader an error."""

    def dispatch(program, groups, **bindings):
        pytest.fail(f"{program.compute} ran")

    return lambda: monkeypatch.setattr(target, "dispatch_groups", dispatch)


def test_blocks_are_drawn(no_compute):
    seen = SeenSurface(grid(1, 1), (70, 40))
    no_compute()
    assert surface_tables.find_blocks(seen.hits, seen.labels).masks[..., 0].tolist() == [[2, 2, 2], [2, 2, 2]]


def test_hits_are_removed_by_drawing_seed_1(no_compute):
    seen = SeenSurface(grid(1, 1), (20, 10))
    is_known = np.random.default_rng(1).random((10, 20)) < 0.5
    normals = texture(np.repeat(is_known[..., None], 4, axis=-1))
    no_compute()
    high_in_uv.clip_hits(seen.hits, normals)
    seen.draw_normals(seen.drawn_normals, np.eye(3))
    assert np.array_equal(read(seen.drawn_normals)[..., 3] == 1.0, is_known)


def test_a_texture_is_copied_by_drawing_before_it_is_read_seed_2(monkeypatch):
    values = np.random.default_rng(2).normal(size=(6, 5, 4)).astype(np.float32)
    shown, copied, whole = texture(values), [], target.fill
    monkeypatch.setattr(
        target, "fill", lambda *a, **bindings: (copied.append(bindings["source"]), whole(*a, **bindings))
    )
    found = np.empty((4, 5, 4), np.float32)
    target.read(shown, found)
    assert np.array_equal(found, values[:4])
    assert copied == [shown]
