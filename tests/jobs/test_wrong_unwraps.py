# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever the mesh is, Unwrap gives UVs of which none overlap and none are turned over, or a sentence, and no traceback."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.core.errors import BakeError
from addon.core.progress import finish
from addon.core.settings import Settings
from addon.jobs import fixes, flattening, unwrapping
from addon.mesh import uv_layout, uv_stretch
from addon.scene import mesh_reader
from tests.jobs.test_unwrapping import state
from tests.support import zoo

SETTINGS = Settings(width=512, height=512)
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def build(points, faces):
    data = bpy.data.meshes.new("lo")
    data.from_pydata(points, [], faces)
    obj = bpy.data.objects.new("lo", data)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.update()
    return obj


def sheet(change=lambda obj: None):
    """A bent sheet of 16 quads, without UVs, changed in a way."""
    obj = zoo.terrain("lo", 4, height=0.3)
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    change(obj)
    bpy.context.view_layer.update()
    return obj


def fan(blades):
    """Triangles around one edge."""
    angles = 2.0 * np.pi * np.arange(blades) / blades
    tips = np.stack([np.cos(angles), np.sin(angles), 0.5 + 0.0 * angles], axis=1)
    return build([(0, 0, 0), (0, 0, 1), *tips.tolist()], [(0, 1, 2 + k) for k in range(blades)])


def moebius(count=24):
    angles = np.repeat(2.0 * np.pi * np.arange(count) / count, 2)
    across = np.tile([-0.3, 0.3], count)
    radius = 1.0 + across * np.cos(0.5 * angles)
    points = np.stack([radius * np.cos(angles), radius * np.sin(angles), across * np.sin(0.5 * angles)], axis=1)
    strip = [(2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1) for k in range(count - 1)]
    return build(points.tolist(), [*strip, (2 * count - 2, 1, 0, 2 * count - 1)])


def loose_quads(count):
    rng = np.random.default_rng(3)
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0][:, :2]
    size = np.exp(rng.normal(0.0, 0.5, (count, 1, 1)))
    points = rng.uniform(-9.0, 9.0, (count, 1, 3)) + size * np.einsum("kc,ncd->nkd", np.array(SQUARE)[:, :2], axes)
    return build(points.reshape(-1, 3).tolist(), np.arange(4 * count).reshape(-1, 4).tolist())


def one_point(value):
    return lambda obj: setattr(obj.data.vertices[3], "co", (value, 0.0, 0.0))


def scaled(*scale):
    return lambda obj: setattr(obj, "scale", scale)


def transformed(matrix):
    return lambda obj: obj.data.transform(matrix)


def seams(chosen):
    return lambda obj: [setattr(edge, "use_seam", chosen(edge.index)) for edge in obj.data.edges]


def empty_uvs(obj):
    obj.data.uv_layers.new().uv.foreach_set("vector", np.zeros(2 * len(obj.data.loops), np.float32))


def keys(obj):
    scaled(1.0, 3.0, 1.0)(obj)
    obj.shape_key_add(name="Basis")
    obj.shape_key_add(name="Key").data[5].co.z = 2.0


MESHES = {
    "one triangle": lambda: build(SQUARE[:3], [(0, 1, 2)]),
    "a flat piece and faces without area": lambda: build([*SQUARE, *[(2, 0, 0)] * 4], [(0, 1, 2, 3), (4, 5, 6, 7)]),
    "a face on both sides": lambda: build(SQUARE, [(0, 1, 2, 3), (3, 2, 1, 0)]),
    "a concave face": lambda: build([(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.2, 0), (0, 2, 0)], [(0, 1, 2, 3, 4)]),
    "five faces at an edge": lambda: fan(5),
    "two cones that touch": lambda: build(
        [(0, 0, 0), (1, 0, 1), (0, 1, 1), (-1, 0, 1), (1, 0, -1), (0, 1, -1), (-1, 0, -1)],
        [(0, 1, 2), (0, 2, 3), (0, 3, 1), (0, 5, 4), (0, 6, 5), (0, 4, 6)],
    ),
    "one side": moebius,
    "a thousand loose quads": lambda: loose_quads(1000),
    "a seam that ends inside": lambda: sheet(seams(lambda k: k == 17)),
    "seams everywhere": lambda: sheet(seams(lambda k: True)),
    "UVs that are empty": lambda: sheet(empty_uvs),
    "hidden faces": lambda: sheet(lambda obj: obj.data.polygons.foreach_set("hide", [True] * 16)),
    "shape keys": lambda: sheet(keys),
    "mirrored": lambda: sheet(scaled(-1.0, 1.0, 1.0)),
    "flat by its scale": lambda: sheet(scaled(1.0, 1.0, 0.0)),
    "a point that is no number": lambda: sheet(one_point(np.nan)),
    "huge": lambda: sheet(transformed(Matrix.Scale(1e18, 4))),
    "tiny": lambda: sheet(transformed(Matrix.Scale(1e-18, 4))),
    "far away": lambda: sheet(transformed(Matrix.Translation((1e4, 0.0, 0.0)))),
}


@pytest.mark.parametrize("name", MESHES)
def test_a_strange_mesh_gets_uvs_of_which_none_overlap_or_are_turned(name):
    low = MESHES[name]()
    before, count = state(), len(low.data.uv_layers)
    said = unwrapping.unwrap(low, SETTINGS)
    assert said.startswith("'lo' is unwrapped: ")
    assert state() == before and len(low.data.uv_layers) == count + 1
    mesh = mesh_reader.surface(low.data, low.data.uv_layers.active.name, "lo", np.eye(4), with_faces=True)
    assert mesh.uv.min() >= 0.0 and mesh.uv.max() <= 1.0
    points = mesh.positions[mesh.vertices[mesh.triangles]].astype(np.float64) @ np.array(low.matrix_world)[:3, :3].T
    is_finite = np.isfinite(mesh_reader.points(low.data)).all(axis=1)
    known = np.array([all(is_finite[polygon.vertices]) for polygon in low.data.polygons])[mesh.faces]
    points = points[known] - points[known].mean(axis=(0, 1))
    layout = uv_stretch.measure(points / np.abs(points).max(), mesh.uv[mesh.triangles[known]], 512)
    assert layout.sound > 0.999
    assert layout.angle < 1.1 and layout.area < 1.1
    assert uv_layout.areas(mesh)[known].min() >= 0.0


def all_points(value):
    return lambda obj: obj.data.vertices.foreach_set("co", np.full(3 * len(obj.data.vertices), value, np.float32))


def eight_maps(obj):
    while len(obj.data.uv_layers) < unwrapping.MOST:
        obj.data.uv_layers.new()


REFUSED = {
    "no faces": (lambda: build(SQUARE, []), "has no faces"),
    "no points": (lambda: build([], []), "has no faces"),
    "no area": (lambda: sheet(all_points(0.0)), "faces have no area"),
    "a line": (lambda: build([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)]), "faces have no area"),
    "a bow of two halves": (lambda: build([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2, 3)]), "no area"),
    "a point by its scale": (lambda: sheet(scaled(0.0, 0.0, 0.0)), "faces have no area"),
    "no numbers": (lambda: sheet(all_points(np.nan)), "faces have no area"),
    "eight UV maps": (lambda: sheet(eight_maps), "as many UV maps as a mesh can have: remove one"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_unwrapped_is_told_in_a_sentence_and_stays(name):
    make, sentence = REFUSED[name]
    low = make()
    before, layers = state(), low.data.uv_layers.keys()
    with pytest.raises(BakeError, match=f"^'lo' .*{sentence}[^.]*\\.$"):
        unwrapping.unwrap(low, SETTINGS)
    assert state() == before and low.data.uv_layers.keys() == layers


def test_no_object_without_a_mesh_is_unwrapped():
    with pytest.raises(BakeError, match="'lamp' has no faces: choose a mesh"):
        unwrapping.unwrap(bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT")), SETTINGS)


def test_of_several_those_that_cannot_be_unwrapped_are_told_and_meshes_that_are_shared_get_one_map():
    one, flat, empty = sheet(), build(SQUARE, []), build([], [])
    other = bpy.data.objects.new("other", one.data)
    work = fixes.unwrap([(flat, SETTINGS), (one, SETTINGS), (other, SETTINGS), (empty, SETTINGS)])
    steps, counts = [], set()
    done, failures = finish(work, lambda step: (steps.append(step.done), counts.add(len(one.data.uv_layers))))
    assert counts == {0}  # until all are done
    assert [text.split(":")[0] for text in done] == ["'lo' is unwrapped"]
    assert failures == [f"'lo.00{number}' has no faces: choose a mesh that has some." for number in (1, 2)]
    assert len(one.data.uv_layers) == 1
    assert steps == sorted(steps)
    with pytest.raises(BakeError, match=r"'lo\.001' has no faces"):
        next(fixes.unwrap([(flat, SETTINGS)]))


def test_a_copy_with_shape_keys_keeps_its_points_in_edit_mode():
    with unwrapping._copy(sheet(keys)) as obj:
        before = mesh_reader.points(obj.data)
        with flattening.editing(obj):
            pass
        assert np.array_equal(mesh_reader.points(obj.data), before)
        assert np.ptp(before, axis=0) == pytest.approx((1.0 / 3.0, 1.0, np.ptp(before[:, 2])))


def test_a_mesh_that_changes_meanwhile_stays():
    low = sheet()
    found = finish(unwrapping.find(low, SETTINGS.sampling))
    low.data.clear_geometry()
    low.data.from_pydata(SQUARE, [], [(0, 1, 2, 3)])
    with pytest.raises(BakeError, match="'lo' has changed meanwhile: unwrap it again"):
        unwrapping.apply(low, found)
    assert not low.data.uv_layers
