# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts maps whose channels hold something else than three axes and coverage, and meshes with overlapping UVs."""

import numpy as np
import pytest

from addon.core.errors import BakeError
from tests.support import angles, zoo
from tests.support.conversions import converted, percentile, picture
from tests.support.maps import bake, texel_uv

pytestmark = pytest.mark.usefixtures("gpu_context")

EXACT = 0.002
"""Degrees at the 99th percentile, as for bakes."""
FLAT = (0.5, 0.5, 1.0, 1.0)


@pytest.fixture
def low():
    return zoo.terrain("low", n=9, height=0.3)


@pytest.fixture
def tangent(low):
    """The map of a pair for MikkTSpace, and its map in object space."""
    high = zoo.terrain("high", n=64, height=0.3)
    bake_of = {space: bake(low, high, space=space, basis="MIKKTSPACE", image=space) for space in ("TANGENT", "OBJECT")}
    return bake_of["TANGENT"], bake_of["OBJECT"]


def wave():
    """Numbers (64, 64) from 0 to 1."""
    return (0.5 + 0.5 * np.sin(texel_uv(64, 64) @ (20.0, 11.0))).astype(np.float32)


def test_alpha_that_is_no_coverage_is_not_used(low, tangent):
    found, expected = tangent
    with_gloss = found.copy()
    with_gloss[..., 3] = np.clip(2.0 * wave() - 0.2, 0.0, 1.0)  # of 0, of 1, and between
    picture("gloss", with_gloss)
    new, report = converted(low, "gloss", space="OBJECT")
    assert (new[..., 3] == 1.0).all()
    assert percentile(new, expected) < EXACT
    assert report.warnings == [
        "The alpha of 'gloss' has values between 0 and 1, as other data than coverage has: it is not used, and the new map "
        "does not contain it."
    ]


def test_smooth_borders_of_coverage_are_coverage(low, tangent):
    found = tangent[0].copy()
    found[:, :6, 3], found[:, 6:16, 3] = 0.0, 0.5
    picture("smooth", found)
    new, report = converted(low, "smooth", space="OBJECT")
    assert (new[:, :6, 3] == 0.0).all()
    assert (new[:, 6:, 3] == 1.0).all()
    assert report.warnings == ["9% of the texels of 'smooth' on the mesh have alpha 0, and stay so."]


@pytest.mark.parametrize("blue", [0.0, 0.5, 1.0])
def test_z_is_rebuilt_where_blue_is_the_same_everywhere(low, tangent, blue):
    found, expected = tangent
    without = found.copy()
    without[..., 2] = blue
    picture("two", without)
    new, report = converted(low, "two", space="OBJECT")
    assert percentile(new, expected) < EXACT
    assert report.warnings == ["The blue channel of 'two' is the same everywhere: z is rebuilt from the other two."]


def test_z_is_rebuilt_in_the_channel_that_stores_it(low, tangent):
    found, expected = tangent
    moved = np.stack([np.ones((64, 64)), found[..., 0], 1.0 - found[..., 1], found[..., 3]], axis=-1)
    picture("two", moved)
    before = {"from_red": "-Z", "from_green": "+X", "from_blue": "-Y"}
    new, report = converted(low, "two", before, space="OBJECT")
    assert percentile(new, expected) < EXACT
    assert report.warnings == ["The red channel of 'two' is the same everywhere: z is rebuilt from the other two."]


def test_the_rounding_of_two_channels_is_that_of_the_rebuilt_normals(low, tangent):
    exact = tangent[0].copy()
    exact[..., 2] = 1.0
    rounded = np.rint(exact * 255) / 255
    picture("exact", exact)
    picture("bytes", rounded)
    expected, _ = converted(low, "exact", space="OBJECT")
    new, report = converted(low, "bytes", space="OBJECT")
    off = angles.degrees(angles.decode(new), angles.decode(expected))
    assert report.source_depth == 8
    assert report.source_loss["median"] == pytest.approx(np.median(off), rel=0.15)
    assert report.source_loss["maximum"] == pytest.approx(off.max(), rel=0.25)


def test_a_map_that_is_nearly_flat_has_all_its_channels(low):
    """Blue is 255 everywhere, and its z is right."""
    values = np.full((64, 64, 4), FLAT, np.float32)
    values[..., 0] = np.rint(127.5 + 3.0 * (wave() - 0.5)) / 255
    picture("flat", values)
    assert converted(low, "flat", space="OBJECT")[1].warnings == []


def test_short_normals_keep_their_z(low, tangent):
    """Means of normals are shorter than 1."""
    found, expected = tangent
    short = found.copy()
    short[..., :3] = (short[..., :3] - 0.5) * 0.8 + 0.5
    picture("short", short)
    new, report = converted(low, "short", space="OBJECT")
    assert percentile(new, expected) < EXACT
    assert report.warnings == []


def test_x_in_alpha_is_refused(low, tangent):
    """As in compressed maps of older engines: red and blue are white."""
    found, _ = tangent
    picture("swizzled", np.stack([np.ones((64, 64)), found[..., 1], np.ones((64, 64)), found[..., 0]], axis=-1))
    with pytest.raises(BakeError, match="'swizzled' is no normal map of 'low': only"):
        converted(low, "swizzled")


def test_object_space_has_no_z_to_rebuild():
    """On a plane that faces down, z may be the same below 0 everywhere."""
    low = zoo.plane("low")
    low.data.flip_normals()
    turn = 6.0 * wave()
    values = np.stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), np.full((64, 64), -0.8), np.ones((64, 64))], axis=-1)
    values[..., :3] = values[..., :3] * 0.5 + 0.5
    picture("object", values)
    new, report = converted(low, "object", {"from_space": "OBJECT"}, space="WORLD")
    assert percentile(new, values) < EXACT
    assert report.warnings == []


SHARED_UVS = (
    "100.00% of the texels of 'Mirrored' belong to two or more of its triangles (overlapping UVs): the new map can be right on "
    "only one of them."
)


def roof(*, moved=0.0):
    """Mirrored halves on the same UVs; moved: how far the UVs of one are moved."""
    low = zoo.mirrored(slope=0.5)
    if moved:
        uv = low.data.uv_layers[0].uv
        places = np.empty((len(uv), 2), np.float32)
        uv.foreach_get("vector", places.ravel())
        places[len(uv) // 2 :] = places[len(uv) // 2 :] * (1.0 - moved) + 0.5 * moved
        uv.foreach_set("vector", places.ravel())
    picture("flat", np.full((64, 64, 4), FLAT))
    return low


@pytest.mark.parametrize("space", ["OBJECT", "WORLD"])
def test_mirrored_halves_share_no_map_in_another_space(space):
    low = roof()
    there = converted(low, "flat", space=space)[1]
    back = converted(low, "converted", {"from_space": space}, image="back")[1]
    assert there.warnings == back.warnings == [SHARED_UVS]


def test_mirrored_halves_share_a_map_in_tangent_space():
    assert converted(roof(), "flat", basis="NORMALIZED")[1].warnings == []


def test_other_overlaps_are_reported_in_tangent_space_too():
    (sentence,) = converted(roof(moved=0.2), "flat", basis="NORMALIZED")[1].warnings
    assert "(overlapping UVs): the new map can be right on only one of them." in sentence


def test_from_object_to_world_space_no_triangle_matters():
    low = roof()
    picture("up", np.full((64, 64, 4), FLAT))
    assert converted(low, "up", {"from_space": "OBJECT"}, space="WORLD")[1].warnings == []
