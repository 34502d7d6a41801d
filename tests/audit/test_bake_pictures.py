# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the pictures of a bake: the map, the low mesh lit with it, and its deviations."""

import bpy
import numpy as np
import pytest

from addon.audit.pictures import BACKGROUND, PICTURE_SIDE, UNKNOWN, BakePictures, add_greatest, square_means
from addon.core.map_types import NORMAL
from addon.jobs import Job, Wants, bake_jobs
from addon.mesh.triangle_mesh import Mesh
from tests.support import scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

FLAT = (128, 128, 255)
TILTED = (0.6, 0.0, 0.8)
"""The normal of a high plane with slope -0.75 along x."""


def square(*, uv_offset=(0.0, 0.0), to_world=None):
    """A plane from -1 to 1 in x and y with one tile of UVs."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    return Mesh(
        "square",
        corners,
        np.arange(4, dtype=np.int32),
        np.tile(np.float32((0, 0, 1)), (4, 1)),
        np.array([(0, 1, 2), (0, 2, 3)], np.int32),
        np.eye(4) if to_world is None else to_world,
        uv=(corners[:, :2] + 1) / 2 + np.float32(uv_offset),
        tangents=np.tile(np.float32((1, 0, 0, 1)), (4, 1)),
    )


def stored(color, size=(64, 64), state=2):
    """A map of one color."""
    return np.full((*size, 4), (*color, 1.0), np.float32), np.full(size, state, np.uint8)


def pictures(low, tiles=(1001,), **values):
    return BakePictures(low, tiles, scenes.settings(**values))


def parts(result):
    """The three pictures."""
    assert result.shape == (PICTURE_SIDE, 3 * PICTURE_SIDE, 3)
    return np.hsplit(result, 3)


def encoded(normal):
    return np.asarray(normal) / 2 + 0.5


@pytest.mark.slow
def test_means_are_those_of_the_known_texels():
    texels = np.arange(5 * 3, dtype=np.float32).reshape(5, 3, 1).repeat(4, axis=2)
    is_known = np.ones((5, 3), bool)
    is_known[0, 0] = is_known[4, 2] = False
    means, has_any = square_means(texels, is_known, 2)
    assert means.shape == (3, 2, 3)
    wanted = [
        [(1 + 3 + 4) / 3, (2 + 5) / 2],
        [(6 + 7 + 9 + 10) / 4, (8 + 11) / 2],
        [(12 + 13) / 2, 0],
    ]
    assert means[..., 0] == pytest.approx(np.array(wanted))
    assert has_any.tolist() == [[True, True], [True, True], [True, False]]


def test_the_greatest_of_parts_is_that_of_the_whole_seed_4():
    values = np.random.default_rng(4).random((50, 31)).astype(np.float32)
    into = np.zeros((8, 5), np.float32)
    for start, stop in ((0, 13), (13, 30), (30, 50)):
        add_greatest(into, values[start:stop], start, 7)
    padded = np.zeros((56, 35), np.float32)
    padded[:50, :31] = values
    assert np.array_equal(into, padded.reshape(8, 7, 5, 7).max(axis=(1, 3)))


def test_the_map_is_shown_with_v_up():
    texels, state = stored(encoded((0, 0, 1)))
    texels[:32] = (1.0, 0.0, 0.0, 1.0)  # v below 0.5
    state[:, 60:] = 0
    shown = pictures(square())
    shown.add(1001, {NORMAL.name: (texels, state)})
    drawn, _, _ = parts(shown.result())
    assert tuple(drawn[10, 10]) == FLAT
    assert tuple(drawn[PICTURE_SIDE - 10, 10]) == (255, 0, 0)
    assert tuple(drawn[10, PICTURE_SIDE - 3]) == (BACKGROUND,) * 3


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
def test_the_low_mesh_is_lit_by_its_map(space):
    """The light comes from the upper left, so that a plane that leans to the right is darker."""
    found = []
    for normal in ((0, 0, 1), TILTED):
        shown = pictures(square(), space=space)
        shown.add(1001, {NORMAL.name: stored(encoded(normal))})
        _, lit, _ = parts(shown.result())
        found.append(lit[PICTURE_SIDE // 2, PICTURE_SIDE // 2])
        assert np.ptp(found[-1]) == 0
        assert tuple(lit[1, 1]) == (BACKGROUND,) * 3
    flat, tilted = (int(each[0]) for each in found)
    assert flat > tilted + 20 > BACKGROUND + 20


def test_an_open_mesh_shows_its_front_wherever_it_looks():
    turned = np.diag((1.0, -1.0, -1.0, 1.0))  # looks down
    for to_world in (np.eye(4), turned, np.diag((1e-4, 1e-4, 1e-4, 1.0))):
        shown = pictures(square(to_world=to_world))
        shown.add(1001, {NORMAL.name: stored(encoded((0, 0, 1)))})
        _, lit, _ = parts(shown.result())
        assert lit[PICTURE_SIDE // 2, PICTURE_SIDE // 2, 0] > 100
        assert 0.3 < (lit[..., 0] != BACKGROUND).mean() < 0.9


def test_a_picture_has_its_top_on_top():
    """A triangle whose right angle is at the front and the right is seen with this corner below."""
    shown = pictures(square().with_triangles([0]))
    shown.add(1001, {NORMAL.name: stored(encoded((0, 0, 1)))})
    _, lit, _ = parts(shown.result())
    is_there = lit[..., 0] != BACKGROUND
    assert is_there[PICTURE_SIDE - 55, 113]
    assert not is_there[54, 113]


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_what_is_nearer_hides_what_is_behind(order):
    """Of two planes, the upper one has the left half of the map, which is flat, and the lower one the right half."""
    low = square()
    both = Mesh(
        "both",
        np.concatenate([low.positions + np.float32((0, 0, 0.01)), low.positions]),
        np.arange(8, dtype=np.int32),
        np.tile(low.normals, (2, 1)),
        np.concatenate([[low.triangles, low.triangles + 4][place] for place in order]),
        low.to_world,
        uv=np.concatenate([low.uv * 0.4, low.uv * 0.4 + np.float32(0.55)]),
        tangents=np.tile(low.tangents, (2, 1)),
    )
    texels, state = stored(encoded((0, 0, 1)))
    texels[:, 32:, :3] = encoded(TILTED)
    found = []
    for mesh in (low, both):
        shown = pictures(mesh)
        shown.add(1001, {NORMAL.name: (texels if mesh is both else stored(encoded((0, 0, 1)))[0], state)})
        found.append(parts(shown.result())[1][PICTURE_SIDE // 2, PICTURE_SIDE // 2, 0].astype(int))
    assert abs(found[0] - found[1]) < 2


def test_uvs_that_are_moved_by_whole_tiles_show_the_same_map():
    texels, state = stored(encoded((0, 0, 1)))
    texels[:, 32:, :3] = encoded(TILTED)
    found = []
    for offset in ((0.0, 0.0), (3.0, -2.0)):
        shown = pictures(square(uv_offset=offset))
        shown.add(1001, {NORMAL.name: (texels, state)})
        found.append(parts(shown.result())[1])
    assert np.array_equal(*found)


def test_tiles_lie_where_they_are_in_uv_space():
    shown = pictures(square(), (1013, 1022), udim=True)
    shown.add(1013, {NORMAL.name: stored((1.0, 0.0, 0.0))})
    shown.add(1022, {NORMAL.name: stored((0.0, 1.0, 0.0))})
    drawn, _, _ = parts(shown.result())
    quarter = PICTURE_SIDE // 4
    assert tuple(drawn[3 * quarter, 3 * quarter]) == (255, 0, 0)  # 1013: right, below
    assert tuple(drawn[quarter, quarter]) == (0, 255, 0)
    assert tuple(drawn[quarter, 3 * quarter]) == tuple(drawn[3 * quarter, quarter]) == (BACKGROUND,) * 3


def test_each_triangle_has_the_map_of_its_tile():
    low = square(uv_offset=(1.0, 0.0))
    shown = pictures(low, (1001, 1002), udim=True)
    shown.add(1001, {NORMAL.name: stored((1.0, 0.0, 0.0))})
    shown.add(1002, {NORMAL.name: stored(encoded((0, 0, 1)))})
    drawn, lit, _ = parts(shown.result())
    assert tuple(drawn[PICTURE_SIDE // 2, PICTURE_SIDE // 4]) == (255, 0, 0)
    assert tuple(drawn[PICTURE_SIDE // 2, 3 * PICTURE_SIDE // 4]) == FLAT
    assert tuple(drawn[10, PICTURE_SIDE // 2]) == (BACKGROUND,) * 3
    one = pictures(square())
    one.add(1001, {NORMAL.name: stored(encoded((0, 0, 1)))})
    assert np.array_equal(lit, parts(one.result())[1])


def test_deviations_have_the_colors_of_the_view():
    shown = pictures(square(), width=4, height=4)
    shown.add(1001, {NORMAL.name: stored(encoded((0, 0, 1)), (4, 4))})
    degrees = np.array([(0.0, 5.0, 50.0, 5 / 3)] * 4, np.float32)
    is_known, is_drawn = np.ones((2, 4, 4), bool)
    is_known[3], is_drawn[3, 2:] = False, False
    shown.add_degrees(1001, 0, degrees[:3], is_known[:3], is_drawn[:3])
    shown.add_degrees(1001, 3, degrees[3:], is_known[3:], is_drawn[3:])
    _, _, colors = parts(shown.result())
    step = PICTURE_SIDE // 4
    none, high, over, third = (colors[PICTURE_SIDE - 5, step * column + 5].astype(int) for column in range(4))
    assert none[2] > none[0] + 50 and none[2] > none[1] + 50  # blue
    assert high[0] > 150 and high[1] < 20 and high[2] == 0  # red
    assert np.array_equal(high, over)
    assert third[1] > third[0] + 50  # green
    assert [colors[5, step * column + 5, 0] for column in range(4)] == [UNKNOWN, UNKNOWN, BACKGROUND, BACKGROUND]


def test_values_that_are_no_shares_are_stretched():
    shown = pictures(square(), normal=False, maps=("HEIGHT",))
    texels, state = stored((-2.0, -2.0, -2.0))
    texels[:32], texels[28:36] = 6.0, 2.0
    shown.add(1001, {NORMAL.name: stored((0.5, 0.5, 1.0)), "HEIGHT": (texels, state)})
    drawn, lit, deviation = parts(shown.result())
    assert [drawn[row, 10, 0] for row in (10, PICTURE_SIDE // 2, PICTURE_SIDE - 10)] == [0, 128, 255]
    assert (lit == BACKGROUND).all() and (deviation == BACKGROUND).all()


@pytest.mark.parametrize("values", [{}, {"method": "CAST"}, {"width": 300, "height": 200, "samples": 4}], ids=str)
def test_a_bake_has_a_picture_if_it_is_asked_for(values):
    job = Job(zoo.terrain("low", n=9, height=0.3), [zoo.terrain("high", n=48, height=0.3)])
    bpy.context.view_layer.update()
    (plain,) = bake_jobs.bake_all(bpy.context, [job], scenes.settings(**values))
    assert plain.picture is None
    (report,) = bake_jobs.bake_all(bpy.context, [job], scenes.settings(**values), wants=Wants(pictured=True))
    drawn, lit, deviation = parts(report.picture)
    assert "picture" not in report.to_dict()
    for picture in (drawn, lit, deviation):
        assert (picture != BACKGROUND).any(axis=2).mean() > 0.25
    assert report.deviation["texels"] > 0


def test_a_shared_map_has_a_picture_of_each_low_mesh():
    lows = [zoo.plane("a"), zoo.plane("b")]
    jobs = [Job(low, [zoo.plane(f"{low.name}_high", slope=0.4)]) for low in lows]
    bpy.context.view_layer.update()
    found = bake_jobs.bake_all(bpy.context, jobs, scenes.settings(), wants=Wants(pictured=True), share_image=True)
    assert [report.picture.shape for report in found] == [(PICTURE_SIDE, 3 * PICTURE_SIDE, 3)] * 2
