# SPDX-License-Identifier: GPL-3.0-or-later
"""A vertex group scales the texel density of UV islands: by areas in closed form."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import finish
from addon.core.settings import Settings
from addon.jobs import fixes, unwrapping, uv_density
from addon.scene import mesh_reader
from addon.scene.mesh_elements import write_weights
from tests.support import zoo

SETTINGS = Settings(width=256, height=256, margin=4, storage="MEMORY", material=False)


def squares(name="lo", sides=(1.0, 1.0)):
    """Flat squares apart from each other, of two quads each, the first of which is a quarter of the square."""
    points, quads = [], []
    for number, side in enumerate(sides):
        x, y = np.meshgrid([0.0, 0.25, 1.0], [0.0, 1.0])
        points += (side * np.stack([x, y, 0.0 * x], axis=2).reshape(-1, 3) + (3.0 * number, 0.0, 0.0)).tolist()
        quads += [[6 * number + k for k in quad] for quad in ((0, 1, 4, 3), (1, 2, 5, 4))]
    data = bpy.data.meshes.new(name)
    data.from_pydata(points, [], quads)
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def areas(uv):
    """Of the squares, by the UVs of all corners."""
    quads = np.asarray(uv, float).reshape(-1, 4, 2)
    diagonals = np.stack([quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]], axis=1)
    return 0.5 * np.abs(np.linalg.det(diagonals)).reshape(-1, 2).sum(axis=1)


def found(obj, weights, **more):
    weights = None if weights is None else np.asarray(weights, np.float32)
    return finish(unwrapping.find(obj, SETTINGS.sampling, weights=weights, **more))


@pytest.mark.parametrize(("one", "other", "ratio"), [(1.0, 0.0, 16.0), (1.0, 0.5, 4.0), (0.5, 0.25, 2.0)])
def test_equal_islands_have_areas_by_their_weights(one, other, ratio):
    """Twice the density for 1 and half of it for 0: 4 and a quarter of the area. As both were asked for, no texel is lost."""
    layout = found(squares(), [one] * 6 + [other] * 6)
    first, second = areas(layout.uv)
    assert first / second == pytest.approx(ratio, rel=1e-3)
    assert layout.layout.area == pytest.approx(1.0, abs=1e-3)


def test_weights_count_by_the_area_of_their_faces():
    """The vertices of an island between are 0 on a quarter of it, and 1 on the rest: 0 to 0.25 of the way, then from 0 to 1."""
    first, second = areas(found(squares(), [0.0, 0.0, 1.0] * 2 + [0.5] * 6).uv)
    assert first / second == pytest.approx(16.0 ** (0.75 * 0.5 - 0.5), rel=1e-3)


@pytest.mark.parametrize("is_quick", [False, True])
def test_equal_weights_change_nothing(is_quick):
    low = squares(sides=(1.0, 0.7, 0.4))
    usual, painted = (found(low, weights, is_quick=is_quick).uv for weights in (None, [0.5] * 18))
    assert np.array_equal(usual, painted)


def test_copies_have_the_density_of_their_originals():
    low = squares(sides=(1.0, 1.0, 0.5))
    layout = found(low, [1.0] * 6 + [0.0] * 6 + [0.5] * 6, stacks=True)
    first, second, third = areas(layout.uv)
    assert layout.stacked > 0.0 and first == pytest.approx(second)
    assert first / third == pytest.approx(16.0, rel=1e-3)


def test_the_button_takes_the_weights_of_the_low_mesh():
    """Vertices outside the group count as 0.5."""
    low = squares()
    low.vertex_groups.new(name="Face").add(range(6), 1.0, "REPLACE")
    finish(fixes.unwrap([(low, SETTINGS)], density_group="Face"))
    uv = np.empty(2 * len(low.data.loops), np.float32)
    low.data.uv_layers.active.uv.foreach_get("vector", uv)
    first, second = areas(uv.reshape(-1, 2))
    assert first / second == pytest.approx(4.0, rel=1e-3)


def test_a_missing_group_is_a_sentence():
    """Also where another object has it."""
    low, other = squares(), squares("other")
    write_weights(other, "Face", np.ones(12))
    with pytest.raises(BakeError, match=r"^'lo' has no vertex group 'Face': name one that it has, or none\.$"):
        finish(fixes.unwrap([(low, SETTINGS)], density_group="Face"))
    assert not low.data.uv_layers
    uv_density.check([low, other], "Face")
    assert uv_density.of_mesh(low, "") is None


def test_a_new_low_mesh_has_the_weights_of_the_nearest_high_object():
    """One that is moved and painted along x, beside one without the group; the low mesh lies on both, with an offset."""
    high, plain, low = zoo.plane("high", 4), zoo.plane("plain", 2), zoo.plane("lo", 2)
    points = mesh_reader.points(high.data)
    write_weights(high, "Face", (points[:, 0] - points[:, 0].min()) / np.ptp(points[:, 0]))
    high.location = low.location = (0.0, 0.0, 5.0)
    plain.location = (0.0, 0.0, -5.0)
    bpy.context.view_layer.update()
    read = uv_density.of_highs(bpy.context, [high, plain], "Face", low, modifiers="VIEWPORT")
    x = mesh_reader.points(low.data)[:, 0]
    assert read == pytest.approx((x - x.min()) / np.ptp(x), abs=1e-5)
    low.location = (0.0, 0.0, -4.9)
    bpy.context.view_layer.update()
    assert (uv_density.of_highs(bpy.context, [high, plain], "Face", low, modifiers="VIEWPORT") == 0.5).all()
