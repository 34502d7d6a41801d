# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests where rays start and which way they go, in closed form."""

import numpy as np
import pytest

from addon.core import udim
from addon.mesh import bvh
from addon.passes import rays, target
from tests.support.maps import texel_uv

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
EXACT = 2e-6
"""In components of unit vectors and of places up to 1: single precision, after interpolation."""
SHARE = 2e-5
"""In components of unit vectors whose shares come from distances that single precision has computed."""
SQUARE = np.float32([(0, 0), (1, 0), (1, 1), (0, 1)])
HALVES = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
UP = np.array((0.0, 0.0, 1.0))


def edges_of(ends):
    """Hard edges with a tree over them, from ends (E, 2, 3)."""
    ends = np.float32(ends)
    numbers = np.arange(len(ends) * 2).reshape(-1, 2)
    tree = bvh.build(ends.reshape(-1, 3), numbers[:, [0, 1, 1]])
    return rays.upload_edges(tree, ends[tree.order])


def draw(
    *,
    uv=SQUARE,
    triangles=HALVES,
    position=None,
    smooth=UP,
    straight=UP,
    numbers=(1, 2),
    paint=None,
    edges=None,
    share=0.0,
    width=0.0,
    start=0.0,
    on_cage=False,
):
    """Draw the rays of a square, whose positions are its UVs at z = 0. Normals (3,) are the same at all corners.

    Returns places, numbers, directions and starts, (SIZE, SIZE, n) each.
    """
    uv = np.float32(uv)
    position = np.pad(uv, ((0, 0), (0, 1))) if position is None else np.float32(position)
    mesh = rays.upload(
        np.int32(triangles),
        np.asarray(numbers),
        uv=uv,
        position=position,
        smooth_normal=np.broadcast_to(np.float32(smooth), position.shape),
        straight_normal=np.broadcast_to(np.float32(straight), position.shape),
        paint=None if paint is None else np.float32(paint),
    )
    drawn = target.Target(SIZE, SIZE, ("RGBA32F", "RGBA32F"))
    directions = rays.Directions(rays.no_edges() if edges is None else edges, straight_share=share, blend_width=width)
    rays.draw(drawn, mesh, udim.uv_to_clip(1001), directions, start_offset=start, start_on_cage=on_cage)
    places, away = np.empty((2, SIZE, SIZE, 4), np.float32)
    drawn.read(places)
    drawn.read(away, slot=1)
    return places[..., :3], places[..., 3], away[..., :3], away[..., 3]


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def blended(smooth, straight, share):
    share = np.clip(share, 0.0, 1.0)[..., None]
    return unit(unit(np.asarray(smooth)) * (1.0 - share) + unit(np.asarray(straight)) * share)


def smoothstep(x):
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def distances(points, ends):
    """The distances (N,) of points (N, 3) from the nearest of the segments (E, 2, 3), each one tested."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip(((points[:, None] - start) * along).sum(axis=2) / length, 0.0, 1.0)
    return np.linalg.norm(start + share[..., None] * along - points[:, None], axis=2).min(axis=1)


def test_places_and_numbers_are_those_of_the_low_mesh():
    most = rays.MOST_TRIANGLES
    for numbers in ((1, 2), (4095, 4096), (4097, 8192), (most - 4096, most)):
        places, number, _, _ = draw(numbers=numbers)
        expected = np.pad(texel_uv(SIZE, SIZE), ((0, 0), (0, 0), (0, 1)))
        assert np.abs(places - expected).max() < EXACT
        upper = np.greater(*np.moveaxis(texel_uv(SIZE, SIZE), -1, 0)[::-1])
        lower = upper.T
        assert (number[upper] == numbers[1]).all()
        assert (number[lower] == numbers[0]).all()


def test_texels_without_a_low_mesh_have_no_ray():
    _, number, _, start = draw(uv=SQUARE * 0.5, start=0.3)
    assert np.count_nonzero(number) == SIZE * SIZE / 4
    assert np.array_equal(start > 0.0, number > 0.0)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_directions_have_a_share_of_the_straight_normals(share):
    smooth, straight = (0.0, 0.6, 0.8), (3.0, 0.0, 4.0)  # of any length
    _, _, away, _ = draw(smooth=smooth, straight=straight, share=share)
    assert np.abs(away - blended(smooth, straight, np.float64(share))).max() < EXACT


@pytest.mark.parametrize("width", [0.1, 0.3, 2.0])
def test_directions_beside_a_hard_edge_turn_from_smooth_to_straight(width):
    """Two faces of a box fold along the line u = 0.5. The smooth normals there point halfway between the faces."""
    uv = np.array([(0, 0), (0.5, 0), (0.5, 1), (0, 1), (0.5, 0), (1, 0), (1, 1), (0.5, 1)])
    side = np.repeat((0, 1), 4)
    from_edge = np.abs(uv[:, 0] - 0.5)
    position = np.stack([from_edge * (side == 1), uv[:, 1], -from_edge * (side == 0)], axis=1)
    straight = np.where(side[:, None] == 0, (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    halfway = np.array((-1.0, 0.0, 1.0)) / np.sqrt(2.0)
    smooth = np.where((from_edge > 0.0)[:, None], straight, halfway)
    _, _, away, _ = draw(
        uv=uv,
        triangles=[(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)],
        numbers=(1, 2, 3, 4),
        position=position,
        smooth=smooth,
        straight=straight,
        edges=edges_of([[(0, 0, 0), (0, 1, 0)]]),
        width=width,
    )
    u = texel_uv(SIZE, SIZE)[..., 0]
    distance = np.abs(u - 0.5)
    face = np.where((u < 0.5)[..., None], (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    interpolated = face * (distance / 0.5)[..., None] + halfway * (1.0 - distance / 0.5)[..., None]
    expected = blended(interpolated, face, smoothstep(distance / width))
    assert np.abs(away - expected).max() < SHARE


@pytest.mark.parametrize("count", [1, 3, 40, 700])
def test_the_nearest_hard_edge_decides_seed_1(count):
    """Against the distances to all edges. Some edges have no length."""
    rng = np.random.default_rng(1)
    ends = np.float32(rng.random((count, 1, 3)) * (1, 1, 0.3) + (rng.random((count, 2, 3)) - 0.5) * 0.2)
    ends[::7, 1] = ends[::7, 0]
    width = 0.3
    smooth, straight = (0.0, 0.0, 1.0), (0.8, 0.0, 0.6)
    _, _, away, _ = draw(smooth=smooth, straight=straight, edges=edges_of(ends), width=width)
    points = np.pad(texel_uv(SIZE, SIZE), ((0, 0), (0, 0), (0, 1))).reshape(-1, 3)
    share = smoothstep(distances(points, ends.astype(np.float64)) / width).reshape(SIZE, SIZE)
    assert np.ptp(share) > 0.3  # otherwise the case tests nothing
    assert np.abs(away - blended(smooth, straight, share)).max() < SHARE


def test_painted_values_are_added_to_the_share():
    """From -1 on the left to 1 on the right, on top of 0.25."""
    paint = np.stack([np.ones(4), SQUARE[:, 0] * 2.0 - 1.0], axis=1)
    smooth, straight = (0.0, 0.6, 0.8), (0.6, 0.0, 0.8)
    _, _, away, _ = draw(smooth=smooth, straight=straight, share=0.25, paint=paint)
    share = 0.25 + texel_uv(SIZE, SIZE)[..., 0] * 2.0 - 1.0
    assert share.min() < 0.0
    assert share.max() > 1.0
    assert np.abs(away - blended(smooth, straight, share)).max() < EXACT


def test_painted_factors_multiply_where_rays_start():
    paint = np.stack([SQUARE[:, 1] * 2.0, np.zeros(4)], axis=1)
    _, _, _, start = draw(start=0.4, paint=paint)
    assert np.abs(start - 0.4 * 2.0 * texel_uv(SIZE, SIZE)[..., 1]).max() < EXACT
    assert (draw(start=0.4)[3] == np.float32(0.4)).all()


def test_rays_start_on_the_cage():
    """Its distance, the length of the smooth normals, grows from 0.2 to 0.6 with u. It leans, and so do the rays."""
    lean = np.array((0.6, 0.0, 0.8))
    to_cage = lean * (0.2 + 0.4 * SQUARE[:, :1])
    _, _, away, start = draw(smooth=to_cage, straight=to_cage, on_cage=True, start=9.0)
    u = texel_uv(SIZE, SIZE)[..., 0]
    assert np.abs(start - (0.2 + 0.4 * u)).max() < EXACT
    assert np.abs(away - lean).max() < EXACT
    doubled = np.tile((2.0, 0.0), (4, 1))
    assert np.abs(draw(smooth=to_cage, straight=to_cage, on_cage=True, paint=doubled)[3] - 2.0 * start).max() < EXACT


def test_texels_without_a_smooth_normal_have_no_ray():
    for value in (0.0, 1e-17, np.inf, np.nan):
        assert not draw(smooth=(0.0, value, 0.0))[1].any()


def test_a_missing_straight_normal_leaves_the_smooth_one():
    _, _, away, _ = draw(smooth=(0.0, 0.6, 0.8), straight=(0.0, 0.0, 0.0), share=1.0)
    assert np.abs(away - (0.0, 0.6, 0.8)).max() < EXACT


def test_opposite_normals_have_a_direction():
    _, _, away, _ = draw(smooth=(0.0, 0.0, 1.0), straight=(0.0, 0.0, -1.0), share=0.5)
    assert (away == np.float32((0.0, 0.0, -1.0))).all()


@pytest.mark.parametrize("count", [0, 1, 64, 65, 1000])
def test_points_are_the_first_texels_seed_2(count):
    rng = np.random.default_rng(2)
    points, directions = rng.normal(size=(2, count, 3))
    directions[3:4] = 0.0
    drawn = rays.upload_points(points, directions, 0.5)
    places, away = np.empty((2, drawn.height, drawn.width, 4), np.float32)
    drawn.read(places)
    drawn.read(away, slot=1)
    places, away = places.reshape(-1, 4), away.reshape(-1, 4)
    assert drawn.width * drawn.height >= count
    has_ray = np.arange(len(places)) < count
    has_ray[3:4] = False
    assert np.array_equal(places[:, 3] > 0.0, has_ray)
    kept = has_ray[:count]
    assert np.abs(places[:count, :3] - points)[kept].max(initial=0.0) < EXACT
    assert (
        np.abs(away[:count][kept] - np.pad(unit(directions[kept]), ((0, 0), (0, 1)), constant_values=0.5)).max(
            initial=0.0
        )
        < EXACT
    )
