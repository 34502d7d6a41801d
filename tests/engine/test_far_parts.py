# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of the high mesh that stand off farther than rays usually search."""

import bpy
import numpy as np
import pytest

from addon.engine.unsure_texels import REASONS
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
DIAGONAL = 8.0**0.5
"""Of the low plane."""
ROOM, FARTHEST = 0.03 * DIAGONAL, 0.12 * DIAGONAL


def bake(height, *, size=0.25, low=None, **settings):
    """A plane, and a plate of `size` times its size above it. Returns the heights (SIZE, SIZE) and the report."""
    low, base, plate = low or zoo.plane("lo", 4), zoo.plane("hi", 4), zoo.plane("plate")
    plate.scale, plate.location = (size, size, 1.0), (0.0, 0.0, height)
    bpy.context.view_layer.update()
    report = scenes.bake(low, base, plate, **{"method": "CAST", "maps": ("HEIGHT",), "size": SIZE} | settings)
    return maps.pixels(bpy.data.images[report.maps["height"]["image"]])[..., 0], report


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_a_plate_within_12_percent_of_the_diagonal_is_found(share):
    heights, report = bake(share * FARTHEST)
    stands = np.abs(heights - share * FARTHEST) < 1e-4
    assert np.count_nonzero(stands) == SIZE * SIZE / 16
    assert (np.abs(heights[~stands]) < 1e-4).all()
    assert report.distances["extrusion"] <= FARTHEST * 1.001


def test_the_extrusion_for_far_parts_is_rounded():
    """In the high meshes' local space: GPUs round measurements differently, and all rays start there."""
    height = 0.6 * FARTHEST
    _, report = bake(height)
    extrusion = report.distances["extrusion"] / (np.hypot(DIAGONAL, height) / 2.0)
    assert extrusion == pytest.approx(float(f"{extrusion:.3g}"), rel=1e-6)


def test_a_plate_beyond_them_needs_an_extrusion():
    height = 1.1 * FARTHEST
    heights, report = bake(height)
    assert (np.abs(heights) < 1e-4).all()
    assert report.checks["unsure"]["beyond"] == report.checks["unsure"]["count"] == SIZE * SIZE / 16
    assert any("the map has the inner one. Increase the extrusion" in warning for warning in report.warnings)
    heights, _ = bake(height, extrusion=1.2 * FARTHEST, max_distance=2.0 * FARTHEST)
    assert np.count_nonzero(np.abs(heights - height) < 1e-4) == SIZE * SIZE / 16


def test_without_far_parts_rays_search_the_usual_room():
    _, report = bake(0.0)
    assert report.distances["extrusion"] == pytest.approx(ROOM, rel=1e-4)


def test_with_a_length_that_is_set_rays_still_reach_what_was_measured_inside():
    heights, report = bake(0.6 * FARTHEST, max_distance=0.02)
    assert report.distances["max_distance"] == pytest.approx(0.02)
    assert (np.abs(heights) < 1e-4).all()
    assert report.missed == 0.0


@pytest.mark.parametrize(
    ("size", "is_part", "reason", "sentence"),
    [
        (0.45, True, None, None),
        (0.6, True, "covered", "the map has the outer one. With the hit nearest it has the inner one"),
        (0.75, True, "covered", "the map has the outer one. With the hit nearest it has the inner one"),
        (1.0, False, "beyond", "the map has the inner one. Increase the extrusion"),
    ],
)
def test_what_covers_much_is_named_and_what_covers_all_is_another_layer(size, is_part, reason, sentence):
    height = 0.07 * DIAGONAL
    heights, report = bake(height, size=size)
    stands = np.abs(heights - height) < 1e-4
    below = np.abs(2.0 * maps.texel_uv(SIZE, SIZE) - 1.0).max(axis=2) < size
    np.testing.assert_array_equal(stands, below & is_part)
    check = report.checks["unsure"]
    assert {name: check[name] for name in REASONS if check[name]} == ({reason: check["count"]} if reason else {})
    if sentence is None:
        assert not any("two surfaces" in warning for warning in report.warnings)
    else:
        assert check["share"] == below.mean()
        assert any(sentence in warning for warning in report.warnings)


def test_the_inner_one_of_two_surfaces_can_be_chosen():
    heights, report = bake(0.07 * DIAGONAL, size=0.75, hit="NEAREST")
    assert (np.abs(heights) < 1e-4).all()
    assert report.checks["unsure"]["count"] == 0


def test_with_distances_that_are_set_there_is_no_doubt_about_what_covers_much():
    height = 0.07 * DIAGONAL
    heights, report = bake(height, size=0.75, extrusion=FARTHEST, max_distance=2.0 * FARTHEST)
    assert (np.abs(heights - height) < 1e-4).any()
    assert report.checks["unsure"]["count"] == 0


def test_what_belongs_to_another_part_of_the_low_mesh_is_no_part_that_stands_off():
    """The low mesh has the plate as well: rays of the base do not search as far as that."""
    height = 0.07 * DIAGONAL
    square, upper = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]), 0.4
    points = np.concatenate(
        [np.column_stack([scale * square, np.full(4, z)]) for scale, z in ((1, 0), (upper, height))]
    )
    halves = np.stack([(square + 1) / (4, 2), (square + 1) / (4, 2) + (0.5, 0)])
    low = zoo.build("lo", points, np.arange(8).reshape(2, 4), halves)
    _, report = bake(height, size=upper, low=low)
    assert report.distances["extrusion"] < 0.05 * DIAGONAL
