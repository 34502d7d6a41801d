# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests meshes with a UV layout that equal their mirror images: coarser ones do so to the bit, whatever their layouts are."""

from dataclasses import replace

import numpy as np
import pytest

from addon.mesh import fitting, mirrors
from addon.mesh.collapse import CollapseOptions
from addon.mesh.fitting import FitOptions, surface_samples
from addon.mesh.layout_collapse import Charted, LayoutState, collapse_layout, uv_areas
from addon.mesh.layout_flips import _allowed
from addon.mesh.layout_halves import Halves
from addon.mesh.mirrors import Plane
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import face_normals, unit, unit_normals
from tests.pure.test_collapse import grid
from tests.pure.test_fitting import sphere
from tests.pure.test_layout_collapse import BOX, LEFT, MIRRORED, RIGHT, ROOM, blocks, charted, volume
from tests.pure.test_quadrics import fold, motion_of

PLANE = Plane(0, 0.0)
TURNED = [[0.0, 0.1, 0.0, 0.6], [-0.3, 0.1, 0.0, 0.2]]
"""UVs that are no mirror image of LEFT, and sheared."""
UPRIGHT = [[0.2, 0.1, 0.0, 0.5], [0.0, 0.2, 0.1, 0.5]]


def mirrored(points, triangles, place=0.0):
    """Two of the half beyond a plane."""
    plane = Plane(0, place)
    points, triangles = mirrors.half(points.astype(np.float64), triangles, plane)
    points, triangles = mirrors.doubled(points, triangles, points[:, 0] == place, plane)
    return points.astype(np.float64), triangles


def coarser(mesh, count, room=ROOM, motions=None):
    halves = Halves.of(mesh)
    options = CollapseOptions(count // 2, motions=halves.motions(motions))
    return halves.joined(collapse_layout(halves.half, options, room))


def equals_its_mirror(mesh, place=0.0):
    """Whether it does to the bit, and no edge has more than two triangles."""
    corners = mesh.points.astype(np.float32)[mesh.triangles].reshape(2, -1, 3, 3)
    same = np.array_equal(corners[0], Plane(0, place).mirrored(corners[1][:, ::-1]))
    return same and not EdgeTable.of(mesh.triangles).is_crowded.any()


def islands_of(points, triangles, axis):
    return (points[triangles].mean(axis=1)[:, axis] > 0.0).astype(int)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("place", [0.0, 0.7])
def test_halves_are_found(axis, place):
    """Of a square, turned to each axis; its diagonals are one another's image in x alone."""
    points, triangles = mirrored(*grid(4))
    points = np.roll(points, axis, axis=1)
    points[:, axis] += place
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT)
    halves = Halves.of(mesh)
    assert halves.plane == Plane(axis, pytest.approx(place))
    assert np.allclose(points[halves.vertices], halves.plane.mirrored(points))
    assert np.array_equal(halves.vertices[triangles], triangles.reshape(-1)[halves.corners])
    assert (points[triangles[halves.half.faces]][..., axis] >= place).all() and len(halves.half.triangles) == 16
    assert np.array_equal(
        halves.half.values[..., 2:4], mesh.values.reshape(-1, 3)[halves.corners[halves.half.faces], :2]
    )


def test_there_are_none_where_something_differs():
    points, triangles = mirrored(*grid(4))
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT)
    assert Halves.of(mesh) is not None
    moved = points.copy()
    moved[-1] += (0.0, 0.0, 1e-3)
    assert Halves.of(replace(mesh, points=moved)) is None

    def of_triangles(triangles, points=points):
        return Halves.of(charted(points, triangles, np.zeros(len(triangles), int), LEFT))

    assert of_triangles(triangles[1:]) is None
    assert of_triangles(np.concatenate([triangles[:1, ::-1], triangles[1:]])) is None
    assert of_triangles(np.concatenate([triangles, triangles[:1]])) is None
    own = np.concatenate([triangles, triangles[:1] + len(points)])  # the same, of other vertices
    assert of_triangles(own, np.concatenate([points, points])) is None
    points, crossing = np.array([(0, -1, 0), (1, 0, 1), (-1, 0, 1), (0, 1.5, 0)]), np.array([(0, 1, 2), (1, 3, 2)])
    assert of_triangles(crossing, points) is None
    assert of_triangles(triangles[:0]) is None


def test_rounding_is_no_difference():
    """Nor are vertices that no triangle has."""
    points, triangles = mirrored(*grid(4))
    points = np.concatenate([points[:3], points])
    noise = 1e-8 * np.sin(np.arange(points.size)).reshape(-1, 3)
    mesh = charted(points + noise + (0.3, 0.0, 0.0), triangles + 3, np.zeros(32, int), LEFT)
    half = Halves.of(mesh).half
    on_plane = LayoutState(half, CollapseOptions(1), ROOM)._on_plane
    assert np.count_nonzero(on_plane[3:]) == 5 and np.array_equal(on_plane[3:], half.on_plane[3:])


def test_poses_of_the_other_side_are_mirrored():
    points, triangles = mirrored(*grid(4))
    points += (0.3, 0.0, 0.0)
    halves = Halves.of(charted(points, triangles, np.zeros(32, int), LEFT))
    motions = np.random.default_rng(6).normal(size=(2, len(points), 3, 4))
    posed = (motions[..., :3] @ points[..., None])[..., 0] + motions[..., 3]
    both = halves.motions(motions)
    images = (both[2:, ..., :3] @ points[..., None])[..., 0] + both[2:, ..., 3]
    assert np.array_equal(both[:2], motions) and halves.motions(None) is None
    assert images == pytest.approx(halves.plane.mirrored(posed[:, halves.vertices]))


@pytest.mark.parametrize(
    ("axis", "uvs", "place"),
    [
        (0, (LEFT, LEFT), 0.0),
        (0, (LEFT, RIGHT), 0.25),
        (0, (LEFT, MIRRORED), 0.0),
        (0, (TURNED, LEFT), 0.25),
        (1, (LEFT, TURNED), 0.25),
    ],
    ids=["one island", "two", "one on the other", "two that differ", "two across the plane"],
)
def test_a_flat_mesh_keeps_its_islands_on_both_sides(axis, uvs, place):
    points, triangles = mirrored(*grid(8))
    islands = islands_of(points, triangles, axis)
    order = np.random.default_rng(3).permutation(len(triangles))
    triangles, islands = triangles[order], islands[order]
    points = np.concatenate([points + (place, 0.0, 0.0), [(9.0, 0.0, 0.0)]])  # a vertex that no triangle has
    mesh = charted(points, triangles, islands, *uvs)
    mesh = replace(mesh, labels=0 * islands if uvs[0] is uvs[1] else islands)
    coarse = coarser(mesh, 20)
    assert len(coarse.triangles) <= 20 and (face_normals(coarse.points, coarse.triangles)[:, 2] > 0.0).all()
    assert equals_its_mirror(coarse, place)
    which = coarse.labels
    assert np.array_equal(which, mesh.labels[coarse.faces])
    assert np.array_equal(coarse.values[..., 2], np.repeat(islands[coarse.faces][:, None], 3, axis=1))
    expected = charted(coarse.points, coarse.triangles, which, *uvs)
    assert coarse.values[..., :2] == pytest.approx(expected.values[..., :2], abs=1e-6)
    areas = [np.abs(uv_areas(each.values, 1))[:, 0].sum() for each in (mesh, coarse)]
    assert areas[1] == pytest.approx(areas[0], rel=1e-3)
    edges = EdgeTable.of(coarse.triangles)
    if uvs[0] is uvs[1]:  # the halves hang together
        assert coarse.on_line.sum() == edges.is_open.sum()
    rim = np.abs(coarse.points[edges.ends[edges.is_open]] - (place, 0.0, 0.0)).max(axis=2)
    assert rim == pytest.approx(1.0, abs=1e-6)


def globe(rings):
    """A sphere whose UVs are its longitude and its height, cut along one meridian, off the plane."""
    points, triangles = mirrored(*sphere(rings))
    corners = points[triangles]
    longitude = np.arctan2(corners[..., 1], corners[..., 0]) / (2.0 * np.pi)
    middles = corners.mean(axis=1)
    reference = np.arctan2(middles[:, 1], middles[:, 0]) / (2.0 * np.pi)
    longitude += np.round(reference[:, None] - longitude)
    at_pole = np.hypot(corners[..., 0], corners[..., 1]) < 1e-6
    longitude = np.where(at_pole, reference[:, None], longitude)
    uv = np.stack([0.5 + 0.9 * longitude, 0.5 + 0.2 * corners[..., 2]], axis=2)
    return Charted(points, triangles, uv, np.zeros(len(triangles), int))


@pytest.mark.parametrize("count", [200, 8])
def test_halves_of_a_sphere_meet_along_their_border_alone(count):
    mesh = globe(12)
    coarse = coarser(mesh, count)
    assert equals_its_mirror(coarse) and (EdgeTable.of(coarse.triangles).counts == 2).all()
    assert len(coarse.triangles) <= max(count, 80) and volume(coarse) > 0.85 * volume(mesh)
    assert (coarse.points[coarse.triangles[: len(coarse.triangles) // 2]][..., 0] >= 0.0).all()
    assert (np.abs(coarse.points[coarse.triangles][..., 0]).max(axis=1) > 0.0).all()
    before = uv_areas(mesh.values, 1)[coarse.faces]
    assert (uv_areas(coarse.values, 1) * np.sign(before) > 0.0).all()


@pytest.mark.parametrize(
    ("filled", "size", "fewest"),
    [(BOX, (1.0, 1.0, 1.0), 20), (BOX, (1.0, 1.0, 0.05), 20)],
    ids=["box", "plate"],
)
def test_walls_stay_whole_on_both_sides(filled, size, fewest):
    """As in test_layout_collapse. Edges in the plane stay, and make two rectangles of each wall that crosses it."""
    mesh = blocks(filled, size)
    points, triangles = mirrored(mesh.points, mesh.triangles, 0.5 * size[0])
    normals, middles = unit_normals(points[triangles])[0], points[triangles].mean(axis=1)
    heights = np.round((normals * middles).sum(axis=1), 6)
    _, islands = np.unique(np.column_stack([np.round(normals, 6), heights]), axis=0, return_inverse=True)
    islands = islands.reshape(-1)
    axis, uvs = np.abs(normals).argmax(axis=1), np.zeros((islands.max() + 1, 2, 4))
    for each in range(3):
        of = np.unique(islands[axis == each])
        uvs[of, 0, (each + 1) % 3], uvs[of, 1, (each + 2) % 3] = 0.1, 0.1
    uvs[:, 0, 3] = np.arange(len(uvs))
    mesh = charted(points, triangles, islands, *uvs)
    for count in (100, 4):
        coarse = coarser(mesh, count)
        assert equals_its_mirror(coarse, 0.5 * size[0]) and (EdgeTable.of(coarse.triangles).counts == 2).all()
        assert volume(coarse) == pytest.approx(volume(mesh), rel=1e-6)
        assert max(count, fewest) - 2 <= len(coarse.triangles) <= max(count, fewest)


@pytest.mark.parametrize("room", [0.0, 1.0])
def test_borders_of_both_sides_move_outwards_within_their_room(room):
    """Of a square whose layout is bent on the side of the mirror images alone: upwards, so that a straight line between places
    of the upper border lies outside."""
    points, triangles = mirrored(*grid(8))
    islands = islands_of(points, triangles, 0)
    mesh = charted(points, triangles, islands, LEFT, RIGHT)
    values = mesh.values.copy()
    x = points[triangles][..., 0]
    values[..., 1] += np.where(islands == 0, 0.005, 0.0)[:, None] * x**2
    coarse = coarser(replace(mesh, values=values), 8, room)
    at_top = np.isclose(coarse.points[:, 1], 1.0)
    assert (at_top.sum() == 9) == (room == 0.0)


def test_what_crosses_the_plane_has_no_border_there():
    """The layout of the plane is bent, so that a straight line in it lies beyond that of one of the halves."""
    points, triangles = mirrored(*grid(8))
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT)
    values = mesh.values.copy()
    values[..., 0] += 0.05 * points[triangles][..., 1] ** 2
    coarse = coarser(replace(mesh, values=values), 20, 0.0)
    assert (coarse.points[:, 0] == 0.0).sum() < 7
    sides = islands_of(points, triangles, 0)[:, None, None]
    cut, folded = values + 2.0 * sides, values.copy()
    folded[..., 0] -= 0.4 * points[triangles][..., 0] * sides[..., 0]  # the halves lie on each other
    for each in (cut, folded):
        coarse = coarser(replace(mesh, values=each), 8, 0.0)
        assert (coarse.points[:, 0] == 0.0).sum() == 9


def test_a_border_of_labels_on_one_side_stays():
    points, triangles = mirrored(*grid(8))
    middles = points[triangles].mean(axis=1)
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT)
    coarse = coarser(replace(mesh, labels=((middles[:, 0] < 0.0) & (middles[:, 1] > 0.0)).astype(int)), 16)
    areas = np.bincount(coarse.labels, np.abs(uv_areas(coarse.values, 1))[:, 0])
    assert areas[1] == pytest.approx(0.25 * areas.sum(), rel=1e-3)


def begun(points, triangles, is_apart=None):
    """A half, before its first edge collapses, and its edges. is_apart: of middles of triangles, those in another island."""
    points, triangles = mirrored(points, triangles)
    islands = (
        np.zeros(len(triangles), int) if is_apart is None else is_apart(points[triangles].mean(axis=1)).astype(int)
    )
    mesh, motions = charted(points, triangles, islands, UPRIGHT, TURNED), motion_of(np.eye(3), np.zeros(3), len(points))
    state = LayoutState(Halves.of(mesh).half, CollapseOptions(1, motions=motions), 1.0)
    edges = EdgeTable.of(state.triangles)
    state._allowed(edges)
    return state, edges


DIAMOND = np.array([(0, 0, 0), (1, -1, 0), (2, 0, 0), (1, 1, 0.0)]), np.array([(0, 1, 2), (0, 2, 3)])


@pytest.mark.parametrize(
    ("mesh", "is_apart"),
    [(grid(8), lambda middles: np.abs(middles[:, 0]) > 0.25), (DIAMOND, None)],
    ids=["a border beside it", "one vertex in it"],
)
def test_what_is_in_the_plane_stays_there(mesh, is_apart):
    """Even where what lies beside it costs more to move."""
    state, edges = begun(*mesh, is_apart)
    away = state.points[:, 0] > 0.0
    state._planes[:] = away[:, None, None] * np.eye(3)
    state._offsets[:] = away[:, None] * -state.points
    state._constants[:] = away * (state.points**2).sum(axis=1)
    state._poses.clear()
    for each in state.maps.values():
        for values in (each.matrices, each.offsets, each.constants):
            values[:] = 0.0
    places, _ = state._placed(edges, np.arange(len(edges.ends)))
    at_plane = ~away[edges.ends]
    leads = at_plane[:, 0] != at_plane[:, 1]
    assert leads.any() and (places[leads, 0] == 0.0).all()
    assert np.array_equal(state._shares[leads], at_plane[leads, 1])


def test_nothing_collapses_to_beyond_the_plane():
    """At the border of a sheet that lies beside it."""
    points, triangles = grid(4)
    state, edges = begun(points + (1.1, 0.0, 0.0), triangles)
    at_border = np.isclose(state.points[:, 0], state.points[np.unique(state.triangles), 0].min())
    which = np.flatnonzero(at_border[edges.ends].all(axis=1))[1:2]
    places, _ = state._placed(edges, which)
    assert state._is_good(edges, which, places).all()
    assert not state._is_good(edges, which, places * (-0.1, 1.0, 1.0)).any()


def test_edges_in_the_plane_are_no_borders():
    """Planes along them would be in the way of what moves with its mirror image."""
    state, _ = begun(*grid(4))
    used = np.unique(state.triangles)
    is_inside = state._on_plane[used] & (np.abs(state.points[used, 1]) < 0.4)
    for planes in (state._planes, state._poses[0].quadrics[0]):
        assert is_inside.sum() == 3 and (planes[used[is_inside], 0, 0] == 0.0).all()
        assert (planes[used[state.points[used, 0] > 0.4], 0, 0] > 0.0).all()


def test_what_comes_into_the_plane_gets_no_edge_across_its_border():
    points = np.array([(0, -1, 0), (0, 0, 0), (0, 1, 0), (0.5, 0, 0), (1, -1, 0), (1, 1, 0)])
    state, edges = begun(points, np.array([(0, 3, 1), (1, 3, 2), (0, 4, 3), (3, 5, 2), (3, 4, 5)]))

    def are_good(ends, x):
        which = np.flatnonzero((state.points[edges.ends].sum(axis=1) * 2.0 == ends).all(axis=1))
        owner = np.full(len(state.points), -1)
        owner[edges.ends[which]] = 0
        return state._keeps_halves_apart(edges, which, np.array([(x, 0.0, 0.0)]), owner).tolist()

    middle = np.array([0.5, 0.0, 0.0])
    assert are_good(middle, 0.0) == [True]
    assert are_good(middle + points[0], 0.0) == are_good(middle + points[2], 0.0) == [False]
    assert [are_good(middle + points[4], x) for x in (0.1, -0.1)] == [[True], [False]]


def test_no_triangle_comes_into_the_plane():
    """Those of a flat pyramid of three, which would lie on their mirror images."""
    points = np.array([(0, -1, -1), (0, 1, -1), (0, 0, 1), (0.1, 0, 0)])
    state, _ = begun(points, np.array([(0, 1, 3), (1, 2, 3), (2, 0, 3)]))
    state.run(1)
    assert len(state.triangles) == 3


def test_both_sides_keep_the_line_along_which_a_pose_folds_one():
    points, triangles = mirrored(*grid(8))
    mesh = charted(points, triangles, np.zeros(len(triangles), int), LEFT)
    is_across = []
    for motions in (None, fold(points - (0.5, 0.0, 0.0)), fold(-points - (0.5, 0.0, 0.0))):
        coarse = coarser(mesh, 30, motions=motions)
        x = np.abs(coarse.points[coarse.triangles][..., 0]) - 0.5
        is_across.append(((x.min(axis=1) < -1e-4) & (x.max(axis=1) > 1e-4)).any())
        assert equals_its_mirror(coarse)
    assert is_across == [True, False, False]


def test_vertices_in_the_plane_stay_there():
    """Where those of a half are fitted, and slide."""
    mesh = globe(16)
    halves = Halves.of(mesh)
    half = collapse_layout(halves.half, CollapseOptions(60), ROOM)
    on_plane = half.on_plane
    assert 4 < on_plane.sum() < len(on_plane)
    samples = surface_samples(1.3 * mesh.points + (0.1, 0.0, 0.0), mesh.triangles, 2000)
    folded = halves.plane.folded(samples)
    assert (folded.points[:, 0] >= 0.0).all() and (samples.points[:, 0] < 0.0).any()
    middle = np.where(samples.points[:, :1] < 0.0, (-0.1, 0.0, 0.0), (0.1, 0.0, 0.0))
    assert (((folded.points - middle) * folded.normals).sum(axis=1) > 1.0).all()
    fitted, nearest = fitting.fit(half.points, half.triangles, folded, FitOptions(free=half.free))
    found = nearest, np.full((len(nearest), 3), 1.0 / 3.0)
    slid = fitting.slid(half.points, half.triangles, found, samples, fitting.FitOptions(free=half.free))
    for moved in (fitted, slid):
        assert (moved[on_plane, 0] == 0.0).all() and (np.abs(moved - half.points).max(axis=0) > 0.01).all()


def test_no_edge_turns_into_one_between_vertices_of_the_plane():
    """The half and its image would share it."""
    points = np.array([(0, -1, 0), (0, 1, 0), (0.2, 0, -1), (0.2, 0, 1)])
    upright = [[0.0, 0.0, 0.2, 0.5], [0.0, 0.2, 0.0, 0.5]]
    mesh = charted(points, np.array([(0, 3, 2), (3, 1, 2)]), np.zeros(2, int), upright)
    both = replace(mesh, values=np.tile(mesh.values[..., :2], 2), layers=2, mirror=PLANE)
    assert [len(_allowed(each)[0].old) for each in (mesh, both)] == [1, 0]


def test_even_normals_equal_their_mirror_images():
    rng = np.random.default_rng(4)
    mesh = globe(8)
    halves = Halves.of(mesh)
    normals = unit(rng.normal(size=(len(mesh.points), 3)))
    even = halves.even(normals[mesh.triangles], is_joined=False)
    images = even.reshape(-1, 3)[halves.corners] * (-1.0, 1.0, 1.0)
    assert np.array_equal(even, images) and (even[mesh.points[mesh.triangles][..., 0] == 0.0][:, 0] == 0.0).all()
    coarse = halves.joined(collapse_layout(halves.half, CollapseOptions(60), ROOM))
    even = halves.even(normals[coarse.triangles % len(normals)], is_joined=True).reshape(2, -1, 3, 3)
    assert np.array_equal(even[0], even[1][:, ::-1] * (-1.0, 1.0, 1.0))
    assert unit(even) == pytest.approx(even)
