# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces of the same shape are found: mirrored halves, and parts that are there several times."""

import numpy as np
import pytest

from addon.mesh import uv_stacks
from addon.mesh.triangle_mesh import FaceCorners, Mesh

X = np.array([-1.0, 1.0, 1.0])


def sheet(seed, rows=4, columns=5):
    """A bumpy sheet of quads: points (N, 3) from x = 0 on, and faces."""
    random = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    points = np.stack([u, v, random.uniform(-0.4, 0.4, u.shape)], axis=-1).reshape(-1, 3)
    points[:, :2] += random.uniform(-0.2, 0.2, (len(points), 2)) * (points[:, :1] > 0.0)
    points[points[:, 0] < 0.5, 0] = 0.0
    row, column = np.divmod(np.arange(rows * columns), columns)
    start = row * (columns + 1) + column
    faces = np.stack([start, start + 1, start + columns + 2, start + columns + 1], axis=1)
    return points, [face.tolist() for face in faces]


def mesh_of(points, faces):
    """Faces of any size, as fans."""
    sizes = np.array([len(face) for face in faces])
    starts = np.cumsum([0, *sizes])
    triangles = [(a, a + k, a + k + 1) for a, n in zip(starts, sizes, strict=False) for k in range(1, n - 1)]
    corners = np.concatenate(faces).astype(np.int32)
    return Mesh(
        "mesh",
        points.astype(np.float32),
        corners,
        np.zeros((len(corners), 3), np.float32),
        np.array(triangles, np.int32),
        np.eye(4),
        faces=np.repeat(np.arange(len(faces)), sizes - 2).astype(np.int32),
        face_corners=FaceCorners(starts.astype(np.int32), corners),
    )


def joined(parts):
    """Parts, of points and faces each, as one mesh."""
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    faces = [[start + v for v in face] for start, (_, part) in zip(starts, parts, strict=False) for face in part]
    return mesh_of(np.concatenate([points for points, _ in parts]), faces)


def turned(part, seed, *, is_mirrored=False):
    """A part turned and moved at random, its faces in another order and from other corners."""
    random = np.random.default_rng(seed)
    points, faces = part
    matrix = np.linalg.qr(random.normal(size=(3, 3)))[0]
    matrix *= np.sign(np.linalg.det(matrix)) * (-1.0 if is_mirrored else 1.0)
    faces = [
        np.roll(faces[k][:: -1 if is_mirrored else 1], random.integers(4)).tolist()
        for k in random.permutation(len(faces))
    ]
    return points @ matrix + random.uniform(-20.0, 20.0, 3), faces


def found(mesh, materials=None):
    starts = mesh.face_corners.starts[:-1]
    return uv_stacks.copies(mesh, starts, np.zeros(len(starts), int) if materials is None else materials)


def originals(mesh, copies):
    """For each face that is a copy its original, which has all of its corners."""
    starts = mesh.face_corners.starts
    of = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    result = {}
    for face, (a, b) in enumerate(zip(starts[:-1], starts[1:], strict=True)):
        (there,) = set(of[copies.corners[a:b]].tolist())
        if there != face:
            result[face] = there
            assert sorted(copies.corners[a:b].tolist()) == list(range(starts[there], starts[there + 1]))
    assert np.array_equal(copies.corners[copies.corners], copies.corners)
    assert copies.is_copy.tolist() == [face in result for face in range(len(starts) - 1)]
    return result


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_one_half_is_a_copy_of_its_mirror(seed, axis, shift):
    points, faces = sheet(seed)
    other = [np.roll([v + len(points) for v in face[::-1]], seed).tolist() for face in faces]
    both = np.roll(np.concatenate([points, points * X]), axis, axis=1) + np.eye(3)[axis] * shift
    mesh = mesh_of(both, [*faces, *other])
    copies = found(mesh)
    assert originals(mesh, copies) == {face + len(faces): face for face in range(len(faces))}
    mirror = 2.0 * shift * np.eye(3)[axis] + both[mesh.vertices] * (1.0 - 2.0 * np.eye(3)[axis])
    assert both[mesh.vertices[copies.corners]][len(mesh.vertices) // 2 :] == pytest.approx(
        mirror[len(mesh.vertices) // 2 :]
    )


def test_faces_on_the_mirror_and_without_one_are_no_copies():
    """A roof of three rows, of which the middle one is its own mirror, and a face more on one side."""
    points = np.array(
        [(x, y, z) for x, z in ((-3, 0), (-1, 1), (1, 1), (3, 0)) for y in (0.0, 1.0)] + [(5, 0, 0), (5, 1, 0)]
    )
    faces = [[2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(4)]
    assert originals(mesh_of(points, faces), found(mesh_of(points, faces))) == {0: 2}


def test_little_that_is_mirrored_counts_for_nothing():
    points, faces = sheet(0)
    lonely = np.concatenate([points, points[[0, 1, 6, 7]] * X])
    mesh = mesh_of(lonely, [*faces, [len(points) + k for k in (1, 0, 2, 3)]])
    assert found(mesh) is None


@pytest.mark.parametrize("seed", range(4))
def test_equal_parts_are_copies_of_the_first(seed):
    part, other = sheet(1), sheet(2)
    parts = [
        turned(part, seed),
        turned(other, seed + 10),
        turned(part, seed + 20),
        turned(part, seed + 30, is_mirrored=True),
    ]
    mesh = joined(parts)
    copies = found(mesh)
    of_faces = originals(mesh, copies)
    count = len(part[1])
    assert sorted(of_faces) == list(range(2 * count, 4 * count)) and set(of_faces.values()) == set(range(count))
    points = mesh.positions[mesh.vertices].astype(float)
    for block in (slice(8 * count, 12 * count), slice(12 * count, 16 * count)):
        here, there = points[block], points[copies.corners[block]]
        apart, apart_there = (np.linalg.norm(x[:, None] - x, axis=2) for x in (here, there))
        assert apart == pytest.approx(apart_there, abs=1e-4)


def test_equal_boxes_and_strips_are_copies():
    """Shapes with symmetries of their own, which fit in several ways, and flat ones, which have two sides."""
    box = np.array([(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)], float)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    corner = np.array([(0, 0, 0), (3, 0, 0), (4, 1, 0), (3, 3, 0), (1, 4, 0), (0, 2, 0)], float)
    for part in ((box, sides), (corner, [[0, 1, 2, 3, 4, 5]])):
        for seed in range(4):
            mesh = joined([turned(part, seed), turned(part, seed + 9), turned(part, seed + 99, is_mirrored=True)])
            assert len(originals(mesh, found(mesh))) == 2 * len(part[1])


def test_an_original_is_no_copy():
    """Two equal parts that are each their own mirror: the second is a copy, and nothing else."""
    points, faces = sheet(5)
    both = np.concatenate([points, points * X])
    part = both, [*faces, *([v + len(points) for v in face[::-1]] for face in faces)]
    mesh = joined([part, (both + (0.0, 9.0, 0.0), part[1])])
    assert sorted(originals(mesh, found(mesh))) == list(range(2 * len(faces), 4 * len(faces)))


def test_parts_of_other_materials_and_sizes_are_no_copies():
    part = sheet(1)
    mesh = joined([turned(part, 1), turned(part, 2), turned((1.01 * part[0], part[1]), 3)])
    count = len(part[1])
    assert set(originals(mesh, found(mesh))) == set(range(count, 2 * count))
    assert found(mesh, np.arange(3 * count) // count) is None


def test_what_has_no_copies_has_none():
    assert found(mesh_of(*sheet(3))) is None
    assert found(joined([sheet(3), turned(sheet(4), 1)])) is None


def mirror_of(mesh):
    starts = mesh.face_corners.starts[:-1]
    return uv_stacks.mirror(mesh, starts, np.zeros(len(starts), int))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("axis", range(3))
def test_each_face_has_its_mirror_image_on_the_other_side(seed, axis):
    points, faces = sheet(seed)
    other = [np.roll([v + len(points) for v in face[::-1]], seed).tolist() for face in faces]
    both = np.roll(np.concatenate([points, points * X]), axis, axis=1) + np.eye(3)[axis] * 3.0
    mesh, count = mesh_of(both, [*faces, *other]), len(faces)
    mirror = mirror_of(mesh)
    assert mirror.faces.tolist() == [*range(count, 2 * count), *range(count)]
    assert (mirror.corners[mirror.corners] == np.arange(len(mirror.corners))).all()
    there = 6.0 * np.eye(3)[axis] + both[mesh.vertices] * (1.0 - 2.0 * np.eye(3)[axis])
    assert both[mesh.vertices[mirror.corners]] == pytest.approx(there)
    middles = [both[face, axis].mean() - 3.0 for face in [*faces, *other]]
    assert mirror.sides.tolist() == np.sign(middles).tolist()


def test_faces_across_the_plane_are_their_own_images():
    points = np.array([(x, y, z) for x, z in ((-3, 0), (-1, 1), (1, 1), (3, 0)) for y in (0.0, 1.0)])
    mesh = mesh_of(points, [[2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(3)])
    mirror = mirror_of(mesh)
    assert mirror.faces.tolist() == [2, 1, 0] and mirror.sides.tolist() == [-1, 0, 1]


def test_a_mesh_of_which_a_fifth_has_no_image_is_not_its_own_mirror():
    points = np.array(
        [(x, y * (9 + abs(x)), z) for x, z in ((-3, 0), (-1, 1), (1, 1), (3, 0), (5, 0)) for y in (0.0, 0.1)]
    )
    assert mirror_of(mesh_of(points, [[2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(4)])) is None
    assert mirror_of(mesh_of(points, [[2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(3)])) is not None
