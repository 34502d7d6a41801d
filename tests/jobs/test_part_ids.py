# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the part ID map: the texels of each part, by what each value of ID By tells apart."""

import bpy
import numpy as np
import pytest

from addon.jobs import Job, bake_all
from addon.scene.part_ids import FACE_SETS
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 32
COLUMNS = 4
"""Strips of the plane, from left to right, with two faces each."""


def strips(name, *, gap=0.0):
    """A plane of COLUMNS x 2 quads, whose columns are not joined with each other. gap: between their UVs."""
    points, faces, uv = [], [], []
    for column in range(COLUMNS):
        left, right = column / COLUMNS, (column + 1) / COLUMNS
        for y in (0.0, 0.5, 1.0):
            points += [(2.0 * x - 1.0, 2.0 * y - 1.0, 0.0) for x in (left, right)]
        for row in range(2):
            first = 6 * column + 2 * row
            faces.append([first, first + 1, first + 3, first + 2])
            low, high = row / 2, (row + 1) / 2
            inside = right - gap
            uv.append([(left, low), (inside, low), (inside, high), (left, high)])
    return zoo.build(name, points, faces, uv)


def ids(low, *highs, by, method="CAST"):
    """The number (SIDE, SIDE) of the color of each texel, and the colors by name in the report."""
    report, found = maps.bake_all_maps(
        low, *highs, maps=["PART_ID"], size=SIDE, method=method, id_by=by, extrusion=0.1, max_distance=0.2
    )
    colors = np.round(found["part_id"][..., :3], 4).reshape(-1, 3)
    return np.unique(colors, axis=0, return_inverse=True)[1].reshape(SIDE, SIDE), report.maps["part_id"]["colours"]


def columns_of(numbers):
    """Whether each column of the strips has one number, that no other has."""
    width = SIDE // COLUMNS
    each = [np.unique(numbers[:, width * at : width * (at + 1)]) for at in range(COLUMNS)]
    return [len(one) for one in each] == [1] * COLUMNS and len(np.unique(np.concatenate(each))) == COLUMNS


@pytest.mark.parametrize("method", ["CAST", "FLATTEN"])
@pytest.mark.parametrize("by", ["LOOSE_PART", "UV_ISLAND"])
def test_each_strip_is_a_part_and_an_island(by, method):
    numbers, colors = ids(zoo.plane("lo"), strips("hi"), by=by, method=method)
    assert columns_of(numbers)
    what = "part" if by == "LOOSE_PART" else "UV island"
    assert list(colors) == [f"hi {what} {number}" for number in range(1, COLUMNS + 1)]


def test_a_strip_with_a_seam_is_two_islands_and_one_part():
    high = strips("hi")
    layer = high.data.uv_layers[0].uv
    for corner in range(4):  # the first face moves away from the one above it
        layer[corner].vector[1] -= 0.01
    assert len(np.unique(ids(zoo.plane("lo"), high, by="UV_ISLAND")[0])) == COLUMNS + 1
    assert columns_of(ids(zoo.plane("lo"), high, by="LOOSE_PART")[0])


def test_face_sets_are_those_of_sculpt_mode():
    high = strips("hi")
    attribute = high.data.attributes.new(FACE_SETS, "INT", "FACE")
    attribute.data.foreach_set("value", [7, 3] * COLUMNS)
    numbers, colors = ids(zoo.plane("lo"), high, by="FACE_SET")
    assert list(colors) == ["hi face set 3", "hi face set 7"]
    lower, upper = numbers[: SIDE // 2], numbers[SIDE // 2 :]
    assert np.ptp(lower) == np.ptp(upper) == 0
    assert lower[0, 0] != upper[0, 0]


@pytest.mark.parametrize("domain", ["CORNER", "POINT"])
def test_faces_of_one_vertex_color_are_one_part(domain):
    high = strips("hi")
    attribute = high.data.color_attributes.new("paint", "BYTE_COLOR", domain)
    per_strip = len(attribute.data) // COLUMNS
    shades = np.repeat([[1, 0, 0, 1], [0, 0, 1, 1], [1, 0, 0, 1], [0, 1, 0, 1]], per_strip, axis=0).astype(np.float32)
    attribute.data.foreach_set("color_srgb", shades.ravel())
    numbers, colors = ids(zoo.plane("lo"), high, by="COLOR")
    assert sorted(colors) == ["#0000ff", "#00ff00", "#ff0000"]
    width = SIDE // COLUMNS
    assert numbers[0, 0] == numbers[0, 2 * width] != numbers[0, width] != numbers[0, 3 * width]


def test_objects_of_one_collection_are_one_part():
    left, right = zoo.plane("left"), zoo.plane("right")
    other = bpy.data.collections.new("metal")
    bpy.context.scene.collection.children.link(other)
    for obj, at in ((left, -0.5), (right, 0.5)):
        obj.scale.x, obj.location.x = 0.5, at
    bpy.context.scene.collection.objects.unlink(right)
    other.objects.link(right)
    numbers, colors = ids(zoo.plane("lo"), left, right, by="COLLECTION")
    assert list(colors) == [bpy.context.scene.collection.name, "metal"]
    assert np.ptp(numbers[:, : SIDE // 2]) == np.ptp(numbers[:, SIDE // 2 :]) == 0
    assert numbers[0, 0] != numbers[0, -1]


def test_parts_of_an_atlas_keep_their_own_colors():
    jobs = []
    for name, at in (("a", 0.0), ("b", 0.5)):
        low, high = zoo.plane(f"{name}_low"), zoo.plane(f"{name}_high")
        for corner in low.data.uv_layers[0].uv:
            corner.vector[0] = at + 0.5 * corner.vector[0]
        jobs.append(Job(low, [high]))
    settings = scenes.settings(
        size=SIDE, method="CAST", maps=("PART_ID",), extrusion=0.1, max_distance=0.2, image="both"
    )
    reports = bake_all(bpy.context, jobs, settings, share_image=True)
    assert list(reports[0].maps["part_id"]["colours"]) == ["a_high part 1", "b_high part 1"]
    texels = maps.pixels(bpy.data.images["both_part_id"])[..., :3]
    assert np.ptp(texels[:, : SIDE // 2 - 1], axis=(0, 1)).max() == 0.0
    assert np.abs(texels[0, 0] - texels[0, -1]).max() > 0.1


def test_other_bakes_read_no_parts():
    report, _ = maps.bake_all_maps(zoo.plane("lo"), strips("hi"), maps=["OBJECT_ID"], size=SIDE, id_by="FACE_SET")
    assert list(report.maps["object_id"]["colours"]) == ["hi"]
