# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests collapsing edges within a UV layout: flat islands keep their affine UVs, borders and labels stay, nothing folds."""

from dataclasses import replace

import numpy as np
import pytest

from addon.mesh.carried_normals import (
    COARSER,
    INNER,
    KEPT,
    Framed,
    LaidOut,
    carried_normals,
    common_normals,
    fitted_normals,
)
from addon.mesh.collapse import CollapseOptions
from addon.mesh.layout_collapse import LEAST_UV_AREA, Charted, LayoutState, collapse_layout
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import face_areas, face_normals, unit
from tests.pure.test_collapse import grid
from tests.pure.test_fitting import sphere
from tests.pure.test_quadrics import fold

ROOM = 0.05


def charted(points, triangles, islands, *uvs, labels=None):
    """A mesh whose islands (T,) have affine UVs: uvs has a matrix (2, 4) for each. The values have the island as well."""
    matrices = np.array(uvs)
    corners = np.concatenate([points[triangles], np.ones((len(triangles), 3, 1))], axis=2)
    uv = np.einsum("tij,tcj->tci", matrices[islands], corners)
    values = np.concatenate([uv, np.broadcast_to(islands[:, None, None], (len(triangles), 3, 1))], axis=2)
    return Charted(points, triangles, values, np.zeros(len(triangles), int) if labels is None else labels)


def uv_areas(mesh):
    uv = mesh.values[..., :2]
    return 0.5 * np.linalg.det(uv[:, 1:] - uv[:, :1])


LEFT = [[0.2, 0.0, 0.0, 0.2], [0.0, 0.2, 0.0, 0.2]]
RIGHT = [[0.0, -0.2, 0.0, 0.7], [0.2, 0.0, 0.0, 0.7]]
MIRRORED = [[-0.2, 0.0, 0.0, 0.2], [0.0, 0.2, 0.0, 0.2]]


@pytest.mark.parametrize("right", [LEFT, RIGHT, MIRRORED])
def test_a_flat_mesh_keeps_its_islands(right):
    """Of one island, of two, and of two that are mirrored and lie on each other."""
    points, triangles = grid(16)
    islands = (points[triangles].mean(axis=1)[:, 0] > 0.0).astype(int)
    mesh = charted(points, triangles, islands, LEFT, right)
    coarse = collapse_layout(mesh, CollapseOptions(40), ROOM)
    assert len(coarse.triangles) <= 40 and (face_normals(coarse.points, coarse.triangles)[:, 2] > 0.0).all()
    if right is LEFT:
        islands = np.zeros(len(coarse.triangles), int)
    else:
        assert np.ptp(coarse.values[..., 2], axis=1).max() == 0.0
        islands = coarse.values[:, 0, 2].astype(int)
        sides = coarse.points[coarse.triangles][..., 0] * np.where(islands, 1.0, -1.0)[:, None]
        assert sides.min() > -1e-6 and np.array_equal(mesh.values[coarse.faces, 0, 2], islands)
    expected = charted(coarse.points, coarse.triangles, islands, LEFT, right)
    assert coarse.values[..., :2] == pytest.approx(expected.values[..., :2], abs=1e-6)
    assert np.abs(uv_areas(coarse)).sum() == pytest.approx(np.abs(uv_areas(mesh)).sum(), rel=1e-3)


def test_labels_and_corners_of_their_border_stay():
    points, triangles = grid(16)
    middles = points[triangles].mean(axis=1)
    labels = ((middles[:, 0] > 0.0) & (middles[:, 1] > 0.0)).astype(int)
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT, labels=labels)
    coarse = collapse_layout(mesh, CollapseOptions(30), ROOM)
    areas = 0.5 * np.linalg.norm(face_normals(coarse.points, coarse.triangles), axis=1)
    assert len(coarse.triangles) <= 30 and areas[coarse.labels == 1].sum() == pytest.approx(1.0, abs=1e-3)
    assert np.linalg.norm(coarse.points, axis=1).min() < 1e-3  # where the border turns


def blocks(filled, size=(1.0, 1.0, 1.0)):
    """A closed mesh around the blocks of a grid (X, Y, Z) bool. Each plane is an island, with the places on it as UVs."""
    padded = np.pad(filled, 1)
    quads, islands = [], []
    for axis in range(3):
        for way in (1, -1):
            is_open = padded & ~np.roll(padded, -way, axis)
            low = np.argwhere(is_open) - 1
            low[:, axis] += way > 0
            steps = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]][::way]
            quads.append(np.stack([low, low + steps[0], low + steps[0] + steps[1], low + steps[1]], axis=1))
            islands += [(axis, way, height) for height in low[:, axis]]
    corners, numbers = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c, d = numbers.reshape(-1, 4).T
    kinds, which = np.unique(islands, axis=0, return_inverse=True)
    points = corners / filled.shape * size
    uvs = np.zeros((len(kinds), 2, 4))
    for row, axis in enumerate(kinds[:, 0]):
        uvs[row, [0, 1], [(axis + 1) % 3, (axis + 2) % 3]] = 0.1
    uvs[:, 0, 3] = np.arange(len(kinds))
    return charted(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]), np.tile(which, 2), *uvs)


def volume(mesh):
    return np.linalg.det(mesh.points[mesh.triangles]).sum() / 6.0


BOX = np.ones((4, 4, 4), bool)
ANGLE = BOX.copy()
ANGLE[2:, 2:] = False
TRAY = np.ones((6, 6, 4), bool)
TRAY[1:-1, 1:-1, 1:] = False


@pytest.mark.parametrize(
    ("filled", "size", "fewest"),
    [
        (BOX[:1, :1, :1], (1.0, 1.0, 1.0), 12),
        (BOX, (1.0, 1.0, 1.0), 12),
        (BOX, (1.0, 1.0, 0.05), 12),
        (ANGLE, (1.0, 1.0, 1.0), 20),
        (TRAY, (1.0, 1.0, 1.0), 28),
    ],
    ids=["box", "subdivided box", "plate", "angle", "tray"],
)
def test_walls_stay_whole(filled, size, fewest):
    """Each wall is an island. Whatever is wanted, all levels are closed and have the same volume, down to the fewest triangles
    that have all corners."""
    mesh = blocks(filled, size)
    assert volume(mesh) == pytest.approx(filled.mean() * np.prod(size))
    for count in (100, 60, 40, fewest, fewest - 1, 4):
        coarse = collapse_layout(mesh, CollapseOptions(count), ROOM)
        assert (EdgeTable.of(coarse.triangles).counts == 2).all()
        assert volume(coarse) == pytest.approx(volume(mesh), rel=1e-6)
        assert np.ptp(coarse.values[..., 2], axis=1).max() == 0.0
        assert len(coarse.triangles) == min(len(mesh.triangles), max(count, fewest))


def globe(n=24):
    """A sphere whose UVs are its longitude and its height, cut along one meridian and apart from its poles."""
    points, triangles = sphere(n)
    corners = points[triangles]
    longitude = np.arctan2(corners[..., 1], corners[..., 0]) / (2.0 * np.pi)
    middles = corners.mean(axis=1)
    reference = np.arctan2(middles[:, 1], middles[:, 0]) / (2.0 * np.pi)
    longitude += np.round(reference[:, None] - longitude)
    at_pole = np.hypot(corners[..., 0], corners[..., 1]) < 1e-6
    longitude = np.where(at_pole, reference[:, None], longitude)
    uv = np.stack([0.5 + 0.9 * longitude, 0.5 + 0.2 * corners[..., 2]], axis=2)
    return Charted(points, triangles, uv, np.zeros(len(triangles), int))


def test_a_globe_stays_closed_and_its_map_in_place():
    mesh = globe()
    coarse = collapse_layout(mesh, CollapseOptions(160), ROOM)
    assert len(coarse.triangles) == 160 and (EdgeTable.of(coarse.triangles).counts == 2).all()
    assert (np.sign(uv_areas(coarse)) == np.sign(uv_areas(mesh)[coarse.faces])).all()
    corners = coarse.points[coarse.triangles]
    away = np.hypot(corners[..., 0], corners[..., 1]) > 0.5
    longitude = np.arctan2(corners[..., 1], corners[..., 0]) / (2.0 * np.pi)
    off = (coarse.values[..., 0] - 0.5) / 0.9 - longitude
    assert np.abs(off - np.round(off))[away].max() < 0.05
    assert np.abs(coarse.values[..., 1] - 0.5 - 0.2 * corners[..., 2]).max() < 0.03


def test_places_of_a_globe_lie_near_to_where_their_uvs_do():
    """Half as far as with UVs that are only carried along edges: 0.048 and 0.079."""
    mesh, off = globe(), []
    for count in (160, 80):
        coarse = collapse_layout(mesh, CollapseOptions(count), ROOM)
        corners = np.concatenate([coarse.points[coarse.triangles], coarse.values], axis=2)
        x, y, z, u, v = np.einsum("kc,tcx->xtk", INNER, corners)
        longitude, height = 2.0 * np.pi * (u - 0.5) / 0.9, np.clip((v - 0.5) / 0.2, -1.0, 1.0)
        radius = np.sqrt(1.0 - height**2)
        there = radius * np.cos(longitude), radius * np.sin(longitude), height
        far = np.linalg.norm(np.stack(there) - np.stack([x, y, z]), axis=0).mean(axis=1)
        off.append(np.average(far, weights=face_areas(coarse.points, coarse.triangles)))
    assert off[0] < 0.028 and off[1] < 0.052


def annulus(n=48):
    """A ring with radii 1 and 2 in three rows of quads, whose UVs are a tenth of its places."""
    angles = np.arange(n) * 2.0 * np.pi / n
    radii = np.array([1.0, 4 / 3, 5 / 3, 2.0])
    points = np.stack([np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles)), np.zeros((4, n))], axis=-1)
    a = np.add.outer(np.arange(3) * n, np.arange(n)).reshape(-1)
    b = np.add.outer(np.arange(3) * n, np.roll(np.arange(n), -1)).reshape(-1)
    triangles = np.concatenate([np.stack([a, a + n, b + n], axis=1), np.stack([a, b + n, b], axis=1)])
    points = points.reshape(-1, 3)
    return Charted(points, triangles, 0.5 + 0.1 * points[triangles][..., :2], np.zeros(len(triangles), int))


@pytest.mark.parametrize("room", [0.0, 0.0008, 0.002, 1.0])
def test_borders_move_outwards_within_their_room(room):
    """The chords of the hole's border lie outside the island, and those of its outer border inside it."""
    mesh = annulus()
    coarse = collapse_layout(mesh, CollapseOptions(40), room)
    edges = EdgeTable.of(coarse.triangles)
    flat = 0.1 * coarse.points[np.stack([edges.first[edges.alone], edges.last[edges.alone]], axis=1)][..., :2]
    middles = np.linalg.norm(flat.mean(axis=1), axis=1)
    inner = middles[middles < 0.13]
    farthest = 0.1 * np.cos(np.pi / 48) - inner.min()
    assert -1e-9 <= farthest <= room + 1e-9
    assert (len(inner) == 48) == (room == 0.0)


def test_borders_of_mirrored_islands_move_outwards_alike():
    mesh = annulus()
    mirrored = replace(mesh, values=mesh.values * [-1.0, 1.0])
    one, other = (collapse_layout(each, CollapseOptions(40), 0.0008) for each in (mesh, mirrored))
    assert one.points == pytest.approx(other.points, abs=1e-9) and np.array_equal(one.triangles, other.triangles)


def begun(mesh):
    """A state with the table of its edges, and where all of these would collapse to."""
    state = LayoutState(mesh, CollapseOptions(1), ROOM)
    edges = EdgeTable.of(state.triangles, len(state.points))
    state._allowed(edges)
    return state, edges, state._placed(edges, np.arange(len(edges.ends)))[0]


@pytest.mark.parametrize("stays", [0, 1])
def test_a_border_moves_as_far_as_the_chord_is_from_the_vertex_that_goes(stays):
    """At both ends of an edge of the hole, whichever goes. And how far it had moved before counts, too."""
    state, edges, _ = begun(annulus())
    which = np.flatnonzero((edges.ends < 48).all(axis=1))[:1]
    state._shares[which] = stays
    gone = edges.ends[which, 1 - stays]
    after = state._after(edges, which)
    chord = 0.1 * (1.0 - np.cos(2.0 * np.pi / 48))
    assert state._moved_borders(edges, which, *after)[2].max() == pytest.approx(chord)
    corners = state.triangles.reshape(-1)
    for vertex in (gone, edges.ends[which, stays]):
        state.drift[:] = 0.0
        state.drift[state.wedges.reshape(-1)[corners == vertex]] = 0.5
        assert state._moved_borders(edges, which, *after)[2].max() == pytest.approx(0.5 + chord)


def test_ends_of_edges_stay_on_lines_and_where_lines_meet():
    """On a square of two islands, even where to leave lines costs nothing, and to move what is on none much. The lines are the
    rim and x = 0, which meet where x = 0 and y is 1 or -1."""
    points, triangles = grid(4)
    islands = (points[triangles].mean(axis=1)[:, 0] > 0.0).astype(int)
    state, edges, _ = begun(charted(points, triangles, islands, LEFT, RIGHT))
    inner = (np.abs(points[:, :2]) < 1.0).all(axis=1) & (points[:, 0] != 0.0)
    state._planes[:] = inner[:, None, None] * np.eye(3)
    state._offsets[:] = inner[:, None] * -state.points
    state._constants[:] = inner * (state.points**2).sum(axis=1)
    state._known = tuple(each[:0] for each in state._known)
    state._placed(edges, np.arange(len(edges.ends)))
    x, y = points[edges.ends][..., 0], points[edges.ends][..., 1]
    on_line = (np.abs(x) == 1.0) | (np.abs(y) == 1.0) | (x == 0.0)
    along = ((np.abs(x) == 1.0) & (x[:, :1] == x)).all(axis=1) | ((np.abs(y) == 1.0) & (y[:, :1] == y)).all(axis=1)
    along |= (x == 0.0).all(axis=1)
    meets = (x == 0.0) & (np.abs(y) == 1.0)
    at_end = state._shares[:, None] == [0.0, 1.0]
    to_line = on_line.sum(axis=1) == 1
    assert to_line.any() and np.array_equal(at_end[to_line], on_line[to_line])
    across = on_line.all(axis=1) & ~along
    assert across.any() and at_end[across].any(axis=1).all()
    assert meets.any() and at_end[meets.any(axis=1)].any(axis=1).all()


def test_where_lines_meet_stays_on_a_flat_square():
    """There alone the planes along both lines cost nothing."""
    points, triangles = grid(4)
    islands = (points[triangles].mean(axis=1)[:, 0] > 0.0).astype(int)
    state, edges, places = begun(charted(points, triangles, islands, LEFT, RIGHT))
    seam = (points[edges.ends][..., 0] == 0.0).all(axis=1) & (np.abs(points[edges.ends][..., 1]) == 1.0).any(axis=1)
    outer = np.abs(points[edges.ends[seam]][..., 1]).argmax(axis=1)
    assert seam.sum() == 2
    assert places[seam] == pytest.approx(state.points[edges.ends[seam, outer]], abs=1e-9)


def test_values_are_those_of_the_middle_of_the_edge():
    points, triangles = grid(4)
    state, edges, _ = begun(charted(points, triangles, np.zeros(len(triangles), int), LEFT))
    inner = np.flatnonzero((np.abs(points[edges.ends][..., :2]) < 1.0).all(axis=(1, 2)))[:1]
    state._shares[inner] = 0.5
    _, target, values = state._after(edges, inner)
    first, last = points[edges.ends[inner[0]]]
    expected = np.array(LEFT) @ [*(0.5 * (first + last)), 1.0]
    touching = np.isin(state.triangles, edges.ends[inner])
    assert values[target[state.wedges[touching]], :2] == pytest.approx(np.tile(expected, (touching.sum(), 1)))


@pytest.mark.parametrize(("share", "is_good"), [(0.051, True), (0.049, False)])
def test_a_triangle_keeps_a_twentieth_of_its_area_in_the_layout(share, is_good):
    """Of a flat grid, whose layout has so small a share of what it was for its area on the surface."""
    points, triangles = grid(4)
    state, edges, _ = begun(charted(points, triangles, np.zeros(len(triangles), int), LEFT))
    inner = np.flatnonzero((np.abs(points[edges.ends][..., :2]) < 1.0).all(axis=(1, 2)))[:1]
    state.scales = state.scales / share
    places = state.points[edges.ends[inner]].mean(axis=1)
    assert state._is_good(edges, inner, places).all() == is_good


def test_a_flat_island_keeps_the_line_along_which_poses_fold_it():
    points, triangles = grid(16)
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT)
    is_across = []
    for motions in (None, fold(points)):
        coarse = collapse_layout(mesh, CollapseOptions(40, motions=motions), ROOM)
        x = coarse.points[coarse.triangles][..., 0]
        is_across.append(((x.min(axis=1) < -1e-4) & (x.max(axis=1) > 1e-4)).any())
    assert len(coarse.triangles) <= 40 and is_across == [True, False]


@pytest.mark.parametrize("layer", [0, 1])
def test_nothing_folds_in_a_layout_that_is_a_swirl(layer):
    """It turns by three radians from the middle to the corners of a flat square. The other layer is the square itself."""
    points, triangles = grid(24)
    turned = points[:, 0] + 1j * points[:, 1]
    turned *= np.exp(3j * np.abs(turned) / np.sqrt(2.0))
    uv = 0.5 + 0.3 * np.stack([turned.real, turned.imag], axis=1)
    layers = [points[triangles][..., :2]] * 2
    layers[layer] = uv[triangles]
    mesh = Charted(points, triangles, np.concatenate(layers, axis=2), np.zeros(len(triangles), int), 2)

    def scales(each):
        of_layer = replace(each, values=each.values[..., 2 * layer : 2 * layer + 2])
        return uv_areas(of_layer) / (0.5 * np.linalg.norm(face_normals(each.points, each.triangles), axis=1))

    assert scales(mesh).min() > 0.0
    for count in (100, 30):
        coarse = collapse_layout(mesh, CollapseOptions(count), 1.0)
        assert (scales(coarse) >= LEAST_UV_AREA * scales(mesh)[coarse.faces] * (1.0 - 1e-9)).all()


def test_a_line_that_ends_within_an_island_is_one():
    """A slit from the middle of a square to its rim: at its end, both of its sides have one wedge."""
    points, triangles = grid(4)
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT)
    is_right = points[triangles].mean(axis=1)[:, 0] > 0.0
    corners = points[triangles]
    at_slit = is_right[:, None] & (corners[..., 0] == 0.0) & (corners[..., 1] > 0.0)
    values = mesh.values.copy()
    values[at_slit, 0] += 0.05
    slit = replace(mesh, values=values)
    middle = np.flatnonzero((points[:, :2] == 0.0).all(axis=1))
    assert len(np.unique(slit.wedges[triangles == middle])) == 1
    assert slit.on_line[middle].all() and not mesh.on_line[middle].any()


def test_borders_of_three_islands_meet_where_they_met():
    points, triangles = grid(12)
    middles = points[triangles].mean(axis=1)
    islands = np.where(middles[:, 0] < 0.0, 0, np.where(middles[:, 1] > 0.0, 1, 2))
    far = [[0.2, 0.0, 0.0, 0.7], [0.0, 0.2, 0.0, 0.2]]
    coarse = collapse_layout(charted(points, triangles, islands, LEFT, RIGHT, far), CollapseOptions(30), ROOM)
    areas = 0.5 * np.linalg.norm(face_normals(coarse.points, coarse.triangles), axis=1)
    assert len(coarse.triangles) <= 30
    assert np.bincount(coarse.values[:, 0, 2].astype(int), areas) == pytest.approx([2.0, 1.0, 1.0], abs=1e-3)


def test_wedges_are_what_lines_divide():
    points, triangles = grid(2)
    islands = (points[triangles].mean(axis=1)[:, 0] > 0.0).astype(int)
    mesh = charted(points, triangles, islands, LEFT, RIGHT)
    assert len(np.unique(mesh.wedges)) == 9 + 3
    assert mesh.on_line.all()  # at the rim, or between the islands
    two = replace(mesh, values=np.concatenate([np.zeros_like(mesh.values[..., :2]), mesh.values], axis=2), layers=2)
    assert len(np.unique(two.wedges)) == 9 + 3  # the second layer counts, too
    assert len(np.unique(replace(two, layers=1).wedges)) == 9


def test_normals_of_a_sphere_point_away_from_its_middle():
    points, triangles = sphere(32)
    coarse, few = (each for each in sphere(8))
    found = carried_normals((points[triangles], points[triangles]), coarse[few], coarse[few], few)
    off = np.degrees(np.arccos(np.clip((found * unit(coarse[few])).sum(axis=2), -1.0, 1.0)))
    assert off.max() < 3.0


def test_normals_interpolate_with_the_least_squares():
    """z = x^2 with normals (-2x, 0, 1): on one quad from x = 0 to 1, those of a straight line through them are best, and not
    those at its ends."""
    places = np.linspace(0.0, 1.0, 33)
    x, y = np.meshgrid(places, [0.0, 1.0], indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    a = 2 * np.arange(32)
    triangles = np.concatenate([np.stack([a, a + 2, a + 3], axis=1), np.stack([a, a + 3, a + 1], axis=1)])
    bent = np.maximum(points[:, 0] - 0.9, 0.0) * 10.0  # flat but for a rim
    normals = unit(np.stack([bent, 0.0 * bent, 1.0 - 0.9 * bent], axis=1))[triangles]
    quad = points[[0, 1, -2, -1]]
    corners = np.array([[0, 2, 3], [0, 3, 1]])
    found = carried_normals((points[triangles], normals), quad[corners], quad[corners], corners)
    at_rim = found[0, 1]
    assert np.degrees(np.arccos(at_rim[2])) < 45.0  # at the vertices of the fine mesh: 84
    assert found[:, 0, 2] == pytest.approx(1.0, abs=0.05)


def test_normals_of_a_thin_wall_are_of_their_own_side():
    points, triangles = grid(8)
    back = points + [0.0, 0.0, -0.01]
    whole, both = np.concatenate([points, back]), np.concatenate([triangles, triangles[:, ::-1] + len(points)])
    normals = unit(face_normals(whole, both))[:, None].repeat(3, axis=1)
    coarse, few = grid(2)
    below = np.concatenate([coarse + [0.0, 0.0, -0.006], coarse + [0.0, 0.0, -0.004]])  # nearer to the other side
    twice = np.concatenate([few, few[:, ::-1] + len(coarse)])
    found = carried_normals((whole[both], normals), below[twice], below[twice], twice)
    assert found[: len(few), :, 2] == pytest.approx(1.0) and found[len(few) :, :, 2] == pytest.approx(-1.0)


def bumpy(n, seed=7):
    """A flat grid with random normals near the vertical, one at each vertex."""
    points, triangles = grid(n)
    normals = unit(np.random.default_rng(seed).normal(0.0, 0.1, points.shape) + [0.0, 0.0, 1.0])
    return LaidOut(points[triangles], points[triangles], triangles, normals[triangles])


def test_common_normals_of_equal_meshes_are_their_own():
    fine = bumpy(4)
    for found in common_normals([fine, fine, fine]):
        assert found == pytest.approx(fine.normals, abs=1e-6)


def test_common_normals_are_the_least_squares_of_all_levels():
    """Against a dense solution by another method. The levels are the two triangulations of a square: of each place,
    barycentric coordinates on them follow from its coordinates. The second level counts less."""
    fine, (points, few) = bumpy(2), grid(1)
    levels = few, np.array([(0, 2, 1), (2, 3, 1)])
    places = np.einsum("kc,tcx->tkx", INNER, fine.places).reshape(-1, 3)
    weights = np.repeat(np.sqrt(face_areas(fine.corners)), len(INNER))[:, None]
    of_fine, rows = np.zeros((len(places), 9)), np.arange(len(places))[:, None]
    of_fine[rows, np.repeat(fine.wedges, len(INNER), axis=0)] = np.tile(INNER, (len(fine.wedges), 1))
    of_levels = np.zeros((2, len(places), 4))
    for of_level, triangles in zip(of_levels, levels, strict=True):
        for row, place in enumerate(places):
            for corners in triangles:
                shares = np.linalg.solve(np.vstack([points[corners][:, :2].T, np.ones(3)]), [*place[:2], 1.0])
                if shares.min() > -1e-9:
                    of_level[row, corners] = shares
    wanted = np.einsum("kc,tcx->tkx", INNER, fine.normals).reshape(-1, 3)
    nothing, less = np.zeros((len(places), 4)), weights * COARSER**0.5
    matrix = np.block(
        [
            [of_fine * weights, -of_levels[0] * weights, nothing],
            [of_fine * less, nothing, -of_levels[1] * less],
            [of_fine * weights * KEPT**0.5, nothing, nothing],
        ]
    )
    right = np.concatenate([0.0 * wanted, 0.0 * wanted, wanted * weights * KEPT**0.5])
    expected = unit(np.linalg.lstsq(matrix, right, rcond=None)[0])
    up = np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3))
    found = common_normals([fine, *(LaidOut(points[each], points[each], each, up) for each in levels)])
    assert found[0] == pytest.approx(expected[:9][fine.wedges], abs=1e-5)
    assert found[1] == pytest.approx(expected[9:13][levels[0]], abs=1e-5)
    assert found[2] == pytest.approx(expected[13:][levels[1]], abs=1e-5)
    assert not np.allclose(found[0], fine.normals, atol=0.03)


def test_what_a_level_does_not_show_keeps_its_normals():
    """An island that no level has: that of a level which is nearest to it in the layout says nothing about it."""
    fine, up = bumpy(2), np.array([0.0, 0.0, 2.0])
    two = LaidOut(
        np.concatenate([fine.places, fine.places + up]),
        np.concatenate([fine.corners, fine.corners]),
        np.concatenate([fine.wedges, fine.wedges + 9]),
        np.concatenate([fine.normals, fine.normals]),
    )
    flat = replace(fine, normals=np.broadcast_to([0.0, 0.0, 1.0], fine.normals.shape))
    count = len(fine.wedges)
    found = common_normals([two, flat])[0]
    assert found[count:] == pytest.approx(fine.normals, abs=1e-6)


def framed(normals, n=4):
    """A flat grid with normals (T, 3, 3), whose layout is itself from 0 to 1, and its wedges."""
    points, triangles = grid(n)
    tangents = np.cross([0.0, 1.0, 0.0], normals)
    signs = np.ones((*normals.shape[:2], 1))
    uv = 0.5 + 0.5 * points[triangles][..., :2]
    return Framed(points[triangles], normals, np.concatenate([unit(tangents), signs], axis=2), uv), triangles


TEXELS = np.array([[[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]], [[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]]])


def test_a_map_shows_what_lies_between_its_texels():
    mesh, _ = framed(np.broadcast_to([0.0, 0.0, 1.0], (32, 3, 3)))
    which, shares = np.repeat(np.arange(32), 4), np.tile(INNER, (32, 1))
    shown, own = mesh.shown(TEXELS, which, shares)
    u, v = np.clip(2.0 * np.einsum("nc,ncx->nx", shares, mesh.uv[which]) - 0.5, 0.0, 1.0).T[..., None]
    expected = (1 - v) * ((1 - u) * TEXELS[0, 0] + u * TEXELS[0, 1]) + v * ((1 - u) * TEXELS[1, 0] + u * TEXELS[1, 1])
    assert shown == pytest.approx(unit(expected), abs=1e-9) and (own == [0.0, 0.0, 1.0]).all()


@pytest.mark.parametrize(("degrees", "is_fitted"), [(20.0, True), (90.0, False)])
def test_fitted_normals_show_what_the_finer_mesh_does(degrees, is_fitted):
    """Those of a level that leans. What it shows is as far off, and if that is too far, its texels are of other places."""
    fine, _ = framed(np.broadcast_to([0.0, 0.0, 1.0], (32, 3, 3)))
    leaning = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    level, wedges = framed(np.broadcast_to(leaning, (32, 3, 3)))
    found = fitted_normals(fine, level, wedges, TEXELS)
    left = np.degrees(np.arccos(found[..., 2]))
    assert left.mean() < 3.0 if is_fitted else np.array_equal(found, level.normals)


def test_fitted_normals_are_not_those_of_the_other_side():
    """Of a wall without thickness, whose sides are in the same places."""
    up = np.broadcast_to([0.0, 0.0, 1.0], (32, 3, 3))
    (front, wedges), (back, _) = framed(up), framed(unit(up + [0.3, 0.0, 0.0]))
    turned = Framed(back.corners[:, ::-1], -back.normals, back.tangents, back.uv)
    assert fitted_normals(turned, front, wedges, TEXELS) == pytest.approx(up)
