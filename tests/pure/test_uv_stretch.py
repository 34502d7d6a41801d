# SPDX-License-Identifier: GPL-3.0-or-later
"""How well UVs use a map, in layouts whose figures are known."""

import numpy as np
import pytest

from addon.mesh import uv_stretch

SQUARE = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)


@pytest.mark.parametrize(
    ("scale", "shear", "used", "angle", "sharpness"),
    [
        ((1.0, 1.0), 0.0, 1.0, 1.0, 1.0),
        ((0.5, 0.5), 0.0, 0.25, 1.0, 0.25),
        ((1.0, 0.5), 0.0, 0.5, 2.0, 0.4),  # distances of 1 and 2: their squares have a mean of 2.5
        ((0.5, 0.5), 1.0, 0.25, (3.0 + 5.0**0.5) / 2.0, 1.0 / 6.0),
    ],
)
def test_the_layout_of_a_square_is_known(scale, shear, used, angle, sharpness):
    uv = SQUARE[..., :2] * scale
    uv[..., 0] += shear * uv[..., 1]
    found = uv_stretch.measure(SQUARE, uv)
    assert (found.used, found.angle, found.area) == pytest.approx((used, angle, 1.0))
    assert found.sharpness == pytest.approx(sharpness)


def test_texels_of_two_sizes_have_a_mean():
    """A square has 4 times the area of another one of the same size on the map: factors 2.5 / 1 and 4 / 2.5."""
    points = np.concatenate([SQUARE, 2.0 * SQUARE])
    uv = np.concatenate([SQUARE[..., :2], SQUARE[..., :2]]) * 0.5
    found = uv_stretch.measure(points, uv)
    assert (found.used, found.angle) == pytest.approx((0.5, 1.0))
    assert found.area == pytest.approx(0.2 * 2.5 + 0.8 * 1.6)
    assert found.sharpness == pytest.approx(5.0 / (0.2 * 4.0 + 0.8 * 16.0))


def test_triangles_without_area_do_not_count():
    flat = SQUARE[:1, [0, 1, 1]]
    with_flat = uv_stretch.measure(np.concatenate([SQUARE, flat]), np.concatenate([SQUARE, SQUARE[:1]])[..., :2])
    assert with_flat == uv_stretch.measure(SQUARE, SQUARE[..., :2])
    assert uv_stretch.measure(flat, flat[..., :2]).sharpness == 0.0


def test_the_outlines_of_islands_are_borders():
    """A square of 0.5 in a map of 100 texels: 2.0 long, 0.005 wide, 0.25 used. An inner seam is two sides, 1.0 more."""
    uv = SQUARE[..., :2] * 0.5
    found = uv_stretch.measure(SQUARE, uv, 100)
    assert (found.border, found.islands) == (pytest.approx(2.0 * 0.005 / 0.25), 1)
    assert uv_stretch.measure(SQUARE, uv, 200).border == pytest.approx(0.02)
    apart = uv_stretch.measure(SQUARE, uv + np.array([0.0, 0.25])[:, None, None], 100)
    assert (apart.border, apart.islands) == (pytest.approx((2.0 + 2.0 * 0.5**0.5) * 0.005 / 0.25), 2)
    assert uv_stretch.measure(SQUARE, uv, 3).border == 1.0


def test_an_inner_seam_is_a_border_on_both_sides():
    """A slit in one island: 3 x 3 points, the middle of one side is cut to the center, and opened by a hair."""
    grid = np.stack([*np.mgrid[:3, :3].astype(float), np.zeros((3, 3))], axis=-1).reshape(9, 3)
    quads = np.array([[0, 3, 4, 1], [1, 4, 5, 2], [3, 6, 7, 4], [4, 7, 8, 5]])
    points = grid[quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)]
    uv = points[..., :2] / 2.0
    assert uv_stretch.measure(points, uv, 64).border == pytest.approx(4.0 / 128.0)
    at_cut = (points == grid[1]).all(axis=-1) & (np.arange(8) < 2)[:, None]
    uv[at_cut] -= (0.0, 1e-6)
    found = uv_stretch.measure(points, uv, 64)
    assert (found.border, found.islands) == (pytest.approx(5.0 / 128.0, rel=1e-5), 1)
    assert found.split == pytest.approx(1.0 / 9.0)


def test_split_vertices_are_counted_against_those_of_the_surface():
    apart = SQUARE[..., :2] * 0.5 + np.array([0.0, 0.25])[:, None, None]
    assert uv_stretch.measure(SQUARE, SQUARE[..., :2]).split == 0.0
    assert uv_stretch.measure(SQUARE, apart).split == pytest.approx(2.0 / 4.0)
    # Vertices that the mesh itself has apart are not split by UVs.
    assert uv_stretch.measure(SQUARE, apart, vertices=np.arange(6).reshape(2, 3)).split == 0.0


def test_texels_in_several_triangles_do_not_count():
    """Two squares of the same size: the second lies on a half of the first, then on all of it."""
    points = np.concatenate([SQUARE, SQUARE + (5.0, 0.0, 0.0)])
    uv = np.concatenate([SQUARE[..., :2], SQUARE[..., :2] + (1.0, 0.0)]) * 0.5
    assert uv_stretch.measure(points, uv).sound == 1.0
    uv[2:, :, 0] -= 0.25
    assert uv_stretch.measure(points, uv).sound == pytest.approx(0.5, abs=0.005)  # texels on the diagonal
    uv[2:, :, 0] -= 0.25
    assert uv_stretch.measure(points, uv).sound == 0.0


def test_triangles_that_are_folded_over_do_not_count():
    """The second triangle folds onto the first, and half of the area is lost, and what lies below it is not. Whole islands may
    be mirrored."""
    uv = SQUARE[..., :2] * 0.5
    folded = uv.copy()
    folded[1, 2] = (0.4, 0.1)  # smaller than the other one, which gives the island its side
    found = uv_stretch.measure(SQUARE, folded)
    assert found.sound == pytest.approx(0.125 / (0.125 + 0.075))
    assert uv_stretch.measure(SQUARE, uv[..., ::-1] + 0.0).sound == 1.0


def test_the_figure_has_a_price_for_borders_and_for_split_vertices():
    layout = uv_stretch.Layout(0.9, 1.0, 1.0, 0.8, 0.9, 0.2, 0.5, 3)
    assert layout.figure == pytest.approx(0.9 * 0.8 * 0.9 / 1.05)
    assert uv_stretch.measure(SQUARE, SQUARE[..., :2], 100).figure == pytest.approx(1.0 - 0.5 * 4.0 * 0.005)


def test_islands_without_stretch_need_their_area():
    """Of two squares, one is half as large in UV space as it should be beside the other."""
    points = np.concatenate([SQUARE, 2.0 * SQUARE])
    uv = np.concatenate([SQUARE, SQUARE])[..., :2]
    needs = uv_stretch.needs(points, uv, np.array([0, 0, 1, 1]))
    assert needs.surface == pytest.approx([1.0, 4.0]) and needs.need == pytest.approx([1.0, 4.0])
    assert needs.scale == pytest.approx([1.0, 2.0]) and not needs.is_folded.any()


def test_a_stretched_island_needs_more():
    """Distances of 1 and k need (1 + k * k) / (2 * k) of the squares' area, and their root is the need."""
    for k in (0.5, 3.0):
        needs = uv_stretch.needs(SQUARE, SQUARE[..., :2] * (k, 1.0), np.zeros(2, int))
        more = np.sqrt((1.0 + k * k) / (2.0 * k))
        assert needs.need == pytest.approx([more])
        assert needs.scale**2 * k == pytest.approx([more])  # the area that it gets


@pytest.mark.parametrize("seed", range(2))
def test_no_other_scales_of_islands_are_sharper(seed):
    random = np.random.default_rng(seed)
    points, islands = np.concatenate([SQUARE] * 4), np.repeat(np.arange(4), 2)
    uv = points[..., :2] * random.uniform(0.3, 3.0, (4, 1, 2)).repeat(2, axis=0)
    needs = uv_stretch.needs(points, uv, islands)

    def sharpness(scales):
        found = uv_stretch.measure(points, uv * scales[islands][:, None, None] + 10.0 * islands[:, None, None])
        return found.sharpness / found.used

    best = sharpness(needs.scale)
    assert best == pytest.approx((needs.surface.sum() / needs.need.sum()) ** 2)
    assert all(sharpness(needs.scale * random.uniform(0.95, 1.05, 4)) < best for _ in range(20))


def test_a_folded_sliver_does_not_count():
    """Of a millionth of the length of its island, rounding may fold it."""
    for height, is_folded in ((1e-8, False), (1e-3, True)):
        points = np.concatenate([SQUARE, [[[0.0, 0.0, 0.0], [0.0, -height, 0.0], [1.0, 0.0, 0.0]]]])
        uv = points[..., :2] * (1.0, 1.0)
        uv[2] = uv[2, [0, 2, 1]]
        assert uv_stretch.needs(points, uv, np.zeros(3, int)).is_folded.tolist() == [is_folded]


def test_folded_squashed_and_lost_islands_are_told():
    points, islands = np.concatenate([SQUARE] * 5), np.repeat(np.arange(5), 2)
    uv = points[..., :2].copy()
    uv[2] = uv[2, ::-1]  # turned over
    uv[4] = uv[4] * (1.0, 0.0)  # squashed
    uv[6:8] = 0.0  # lost
    points[9] *= 0.0  # without area on the surface: does not count
    needs = uv_stretch.needs(points, uv, islands)
    assert needs.is_folded.tolist() == [False, True, True, True, False]
    assert needs.need == pytest.approx(needs.surface) and np.isfinite(needs.scale).all()


def test_borders_and_split_vertices_are_those_of_triangles_with_area():
    """A triangle without area comes first, and 0 has two signs."""
    points = np.concatenate([SQUARE[:1, [0, 1, 1]], SQUARE])
    uv = np.concatenate([SQUARE[:1], SQUARE])[..., :2] * 0.5
    uv[2][uv[2] == 0.0] = -0.0
    found = uv_stretch.measure(points, uv, 100, np.array([[7, 8, 9], [0, 1, 2], [0, 2, 3]]))
    assert (found.islands, found.split, found.border) == (1, 0.0, pytest.approx(0.04))


def test_what_is_known_to_be_sound_is_not_looked_at():
    points = np.concatenate([SQUARE, SQUARE + (5.0, 0.0, 0.0)])
    uv = np.concatenate([SQUARE, SQUARE])[..., :2]
    assert [uv_stretch.measure(points, uv, is_sound=known).sound for known in (False, True)] == [0.0, 1.0]
