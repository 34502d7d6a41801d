# SPDX-License-Identifier: GPL-3.0-or-later
"""What closes holes of high meshes, beside what is at their borders."""

from dataclasses import replace

import numpy as np
import pytest

from addon.mesh import small_parts
from addon.mesh.closing import Closing
from addon.mesh.triangle_mesh import UV_LAYER, Mesh
from addon.mesh.triangles import face_normals, transformed, unit

HOLE = {(3, 3), (4, 3), (3, 4)}
"""Three cells of a plate of eight by eight: an L, whose border turns around 1.67 times."""


def plate(to_world, number=1, shift=0.0, without=HOLE):
    """The plate 0..1, or beside it, with UVs that are its places, in its own space."""
    x, y = np.meshgrid(np.arange(9), np.arange(9))
    points = np.stack([x.ravel() / 8 + shift, y.ravel() / 8, 0.0 * x.ravel()], axis=1)
    first = np.array([i + j * 9 for j in range(8) for i in range(8) if (i, j) not in without])
    triangles = np.concatenate(
        [np.stack([first, first + 1, first + 10], 1), np.stack([first, first + 10, first + 9], 1)]
    )
    mesh = Mesh.of_arrays(f"plate {number}", points, triangles, uv=points[:, :2])
    return replace(
        mesh,
        to_world=to_world,
        labels=np.stack([np.full(len(triangles), number), np.arange(len(triangles))], axis=1).astype(np.float32),
        layers={(UV_LAYER, "other"): 2.0 * mesh.uv},
    )


def closing_of(*highs, share=0.5):
    """What closes the holes of meshes, each by itself, in world space."""
    found = []
    for high in highs:
        points, triangles = transformed(high.positions, high.to_world), high.vertices[high.front_triangles]
        points, closed, _ = small_parts.filled(points, triangles, share)
        found.append(Closing.of(points, closed, len(triangles)))
    return Closing(*(np.concatenate([getattr(each, name) for each in found]) for name in ("corners", "normals")))


def scaled(*factors, place=(0.0, 0.0, 0.0)):
    matrix = np.diag([*factors, 1.0])
    matrix[:3, 3] = place
    return matrix


@pytest.mark.parametrize(
    "to_world",
    [np.eye(4), scaled(2.0, 1.5, 3.0, place=(1000.0, -3.0, 5.0)), scaled(-1.0, 1.0, 1.0), scaled(1e-3, 1e-3, 1e-3)],
    ids=["as it is", "uneven and away", "mirrored", "small"],
)
def test_a_hole_gets_the_values_at_its_border(to_world):
    high = plate(to_world)
    closing = closing_of(high)
    (found,) = closing.of_highs([high])
    assert len(found.triangles) == 8 and found.faces is not None and len(found.faces) == 8
    places = transformed(found.positions, found.to_world)
    assert np.allclose(places.reshape(-1, 3, 3), closing.corners, rtol=1e-6, atol=1e-6 * abs(to_world).max())
    facing = face_normals(places, found.vertices[found.front_triangles])
    assert (facing[:, 2] > 0.0).all()
    assert np.allclose(unit(found.to_world_normals(found.normals)), (0.0, 0.0, 1.0), atol=1e-6)
    own = found.positions[:, :2].reshape(-1, 3, 2)
    uv = found.uv.reshape(-1, 3, 2)
    assert np.allclose(
        uv[:, :2], own[:, :2], atol=1e-3
    )  # at the border, the places; in the middle, those of the border
    assert np.allclose(uv[:, 2], own[:, :2].mean(axis=1), atol=1e-3)
    assert np.array_equal(found.layers[UV_LAYER, "other"], 2.0 * found.uv)
    borders = high.positions[high.vertices[high.triangles]][found.labels[:, 1].astype(int)]
    away = np.linalg.norm(borders[:, :, None, :2] - own[:, None, :2], axis=3).min(axis=1)
    assert (found.labels[:, 0] == 1.0).all() and np.allclose(away, 0.0, atol=1e-3)  # both vertices are of that triangle


def test_each_mesh_closes_its_own_holes():
    """The second one has no hole, and the first one of all lies far away."""
    highs = [plate(np.eye(4), 1, 100.0), plate(np.eye(4), 2, 3.0, ()), plate(np.eye(4), 3), plate(np.eye(4), 4, 1.5)]
    found = closing_of(highs[2], highs[3]).of_highs(highs)
    assert [mesh.name for mesh in found] == ["plate 3", "plate 4"]
    assert [np.unique(mesh.labels[:, 0]).tolist() for mesh in found] == [[3.0], [4.0]]
    assert [round(float(mesh.box[0, 0])) for mesh in found] == [0, 2]


def test_a_surface_that_was_thinned_is_beside_the_borders():
    high = plate(np.eye(4))
    closing = closing_of(high)
    (exact,), (found,) = closing.of_highs([high]), closing.moved(np.array([0.02, 0.02, 0.0])).of_highs([high])
    assert np.allclose(found.uv, exact.uv, atol=0.03) and len(found.triangles) == 8
    assert closing.moved(np.array([50.0, 0.0, 0.0])).of_highs([high]) == []  # where nothing is near


def test_vertices_that_no_face_uses_do_not_matter():
    high = plate(np.eye(4))
    closing = closing_of(high)
    loose = replace(
        high, positions=np.concatenate([high.positions, [(np.nan, 0, 0), (np.inf, 0, 0)]]).astype(np.float32)
    )
    with np.errstate(all="raise"):
        (found,) = closing.of_highs([loose])
    assert np.array_equal(found.uv, closing.of_highs([high])[0].uv)


def test_the_middle_is_shaded_as_the_border_around_it():
    """A pyramid without its tip: the normal there is the axis, and at the border it is between the sides and what closes it."""
    around = np.arange(6) * np.pi / 3.0
    rings = [
        np.stack([r * np.cos(around), r * np.sin(around), z + 0.0 * around], 1) for r, z in ((3.0, 0.0), (1.0, 2.0))
    ]
    low, high = np.arange(6), np.arange(6) + 6
    triangles = np.concatenate(
        [np.stack([low, np.roll(low, -1), np.roll(high, -1)], 1), np.stack([low, np.roll(high, -1), high], 1)]
    )
    points, closed, holes = small_parts.filled(np.concatenate(rings), triangles, 0.4)
    closing = Closing.of(points, closed, len(triangles))
    assert holes.mended == 1 and len(closing.corners) == 6
    skewed = np.array([(1.0, 0.7, 0.0, 3.0), (0.0, 2.0, 0.0, 0.0), (0.3, 0.0, 0.5, 0.0), (0.0, 0.0, 0.0, 1.0)])
    high = Mesh.of_arrays("pyramid", transformed(np.concatenate(rings), np.linalg.inv(skewed)), triangles)
    (found,) = closing.of_highs([replace(high, to_world=skewed)])
    assert np.allclose(unit(found.to_world_normals(found.normals)), closing.normals.reshape(-1, 3), atol=1e-6)
    assert np.allclose(closing.normals[:, 2], (0.0, 0.0, 1.0))
    steep = np.degrees(np.arccos(closing.normals[:, :2, 2]))
    assert (steep > 10.0).all() and (steep < 45.0).all()
    assert np.allclose(closing.moved(np.array([1.0, 2.0, 3.0])).corners, closing.corners + (1.0, 2.0, 3.0))
