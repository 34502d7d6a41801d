# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the Python door to game assets and UV maps: arrays out, an open file that stays, sentences for wrong values."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon import api
from addon.api import BakeError, Progress, Surface
from addon.scene import mesh_reader
from tests.support import scenes, snapshot, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 64


def box(cuts):
    """A closed box of 12 cuts² triangles from -1 to 1, whose sides share no vertices."""
    first = (np.arange(cuts) + (cuts + 1) * np.arange(cuts)[:, None]).ravel()
    one = np.concatenate([first[:, None] + corners for corners in ([0, 1, cuts + 2], [0, cuts + 2, cuts + 1])])
    u, v = (2.0 * each.ravel() / cuts - 1.0 for each in np.meshgrid(*[np.arange(cuts + 1)] * 2))
    sides = [
        np.roll(np.stack([u * sign, v, np.full_like(u, sign)], 1), turn, 1) for turn in range(3) for sign in (1, -1)
    ]
    triangles = np.concatenate([one + number * len(u) for number in range(6)])
    points = np.concatenate(sides)
    unique, inverse = np.unique(points.round(6), axis=0, return_inverse=True)
    return unique, inverse.ravel()[triangles]


POINTS, TRIANGLES = box(2)
BOX = Surface(POINTS, TRIANGLES, name="crate_high")


class StopError(Exception):
    pass


def normals_of(surface):
    """The normals of the triangles, of twice their areas as lengths."""
    corners = surface.vertices[surface.triangles]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def asset(high=BOX, **values):
    return api.asset(high, **{"triangles": 12, "size": SIDE} | values)


def uv_areas(uv):
    edges = uv[:, 1:] - uv[:, :1]
    return 0.5 * np.linalg.det(edges)


@pytest.mark.slow
def test_an_asset_is_a_mesh_with_maps():
    before = snapshot.snapshot()
    made = asset(maps=np.array(["Normal", "height"]), triangles=np.float32(12))
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    assert made.mesh.name == "crate_low" and made.levels == ()
    assert len(made.mesh.triangles) == 12 and made.mesh.uv.shape == (12, 3, 2) == made.mesh.normals.shape[:2] + (2,)
    corners = made.mesh.vertices[made.mesh.triangles]
    assert np.abs(np.abs(corners) - 1.0).max() < 1e-4  # the corners of the box, where it is
    volume = np.linalg.det(corners).sum() / 6.0
    assert abs(volume - 8.0) < 1e-3  # seen from outside
    assert 0.0 <= made.mesh.uv.min() <= made.mesh.uv.max() <= 1.0 and (uv_areas(made.mesh.uv) > 0.0).all()
    assert list(made.maps) == ["Normal", "height"] and made.maps["NORMAL"].shape == (SIDE, SIDE, 4)
    assert np.abs(made.maps["height"][..., 0]).max() < 1e-4
    assert made.report["asset"]["limits"] == {"triangles": 12} and made.files == []
    again = api.bake(made.mesh, BOX, size=SIDE)
    assert np.abs(again.maps["normal"] - made.maps["normal"]).max() < 1e-3


def test_a_kept_mesh_is_where_its_object_is(tmp_path):
    obj = zoo.plane("leaf", n=2)
    obj.location, obj.scale = (3.0, 0.0, 1.0), (-2.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    before = snapshot.snapshot()
    made = asset(obj, triangles=None, keep=True, output=tmp_path / "leaf.png")
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    assert made.mesh.vertices.min(axis=0).tolist() == [1.0, -1.0, 1.0]
    assert made.mesh.vertices.max(axis=0).tolist() == [5.0, 1.0, 1.0]
    assert np.einsum("ij,ij->i", normals_of(made.mesh), made.mesh.normals.mean(axis=1)).min() > 0.0
    assert [(tmp_path / "leaf.png")] == [tmp_path / name for name in made.files] and (tmp_path / "leaf.png").is_file()


@pytest.mark.slow
def test_objects_of_an_earlier_asset_stay():
    high = zoo.plane("rock", n=4)
    for name in ("rock_low", "rock_low_LOD0", "rock_low_LOD1"):
        zoo.plane(name)
    home = bpy.data.collections.new("rock_low_LODs")
    bpy.context.scene.collection.children.link(home)
    home.objects.link(bpy.data.objects["rock_low_LOD1"])
    before = snapshot.snapshot()
    made = asset(high, triangles=8, levels=1)
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    assert len(made.mesh.triangles) == 8 and len(made.levels[0].mesh.triangles) < 8
    assert made.levels[0].maps["normal"].tobytes() == made.maps["normal"].tobytes()


def stopping(share):
    def on_progress(progress):
        assert isinstance(progress, Progress)
        if progress.done >= share:
            raise StopError

    return on_progress


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_what_a_listener_raises_ends_an_unwrap(share):
    before = snapshot.snapshot()
    with pytest.raises(StopError):
        api.unwrap(BOX, size=SIDE, on_progress=stopping(share))
    assert snapshot.difference(before, snapshot.snapshot()) == {}


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1, 0.9])
def test_what_a_listener_raises_ends_an_asset(share, tmp_path):
    before = snapshot.snapshot()
    with pytest.raises(StopError):
        asset(output=tmp_path / "crate.png", on_progress=stopping(share))
    assert snapshot.difference(before, snapshot.snapshot()) == {} and not list(tmp_path.iterdir())


WRONG = {
    "triangles": ["x", 3, -5, [], 10**5000, np.nan],
    "degrees": ["x", 0, -1.0, {}],
    "distance": ["x", 0, "5 cm"],
    "crumbs": ["x", 26, -1],
    "holes": ["x", 26, -1],
    "size": ["64", "0/m", "x/m", 15, None],
    "levels": [9, -1, 1.5, "x"],
    "symmetry": ["w", 3],
    "keep": [3, "x"],
    "quads": [None],
    "own_textures": ["no"],
    "stack_mirrored": [2],
    "density_group": [3, "Nowhere"],
    "high": [[], 3, None, "nowhere.obj"],
    "on_progress": [3],
    "udim": [True],
    "smaples": [1],
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_values_are_sentences(name):
    before = snapshot.snapshot()
    for value in WRONG[name]:
        with pytest.raises(BakeError, match=r"\w+ .*[.?]$") as caught:
            asset(**{name: value})
        if name in {"levels", "symmetry", "keep", "quads", "own_textures", "stack_mirrored"}:
            assert str(caught.value).startswith(f"{name}: ")
    with pytest.raises(BakeError, match="Leave out `triangles`"):
        asset(keep=True)
    assert snapshot.difference(before, snapshot.snapshot()) == {}


def test_unwrapped_arrays_keep_their_order():
    before = snapshot.snapshot()
    found = api.unwrap(BOX, size=SIDE)
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    assert np.array_equal(found.triangles, TRIANGLES) and np.array_equal(found.vertices, POINTS.astype(np.float32))
    areas = uv_areas(found.uv)
    assert 0.0 <= found.uv.min() <= found.uv.max() <= 1.0
    assert (areas > 0.0).all() and 0.2 < areas.sum() <= 1.0
    assert areas.max() / areas.min() < 1.01  # triangles of one size: nothing is stretched


def test_unwrapped_objects_stay_as_they_are():
    obj = zoo.plane("leaf", n=2)
    scenes.select(obj)
    before = snapshot.snapshot()
    found = api.unwrap(obj)
    assert snapshot.difference(before, snapshot.snapshot()) == {}
    assert np.abs(uv_areas(found.uv)).sum() > 0.5 and found.name == "leaf"
    with pytest.raises(BakeError, match=r"^density_group: 3 "):
        api.unwrap(obj, density_group=3)
    with pytest.raises(BakeError, match=r"^'leaf' has no vertex group 'Face'"):
        api.unwrap(obj, density_group="Face")


def test_a_vertex_group_scales_the_texels_of_islands():
    """An island with a weight of 1 has four times the area of an equal one outside the group."""
    obj = zoo.plane("leaf")
    data = bpy.data.meshes.new("leaves")
    points = mesh_reader.points(obj.data)
    square = [0, 1, 3, 2]
    data.from_pydata([*points.tolist(), *(points + (0.0, 0.0, 1.0)).tolist()], [], [square, [k + 4 for k in square]])
    obj.data = data
    obj.vertex_groups.new(name="Face").add(range(4), 1.0, "REPLACE")
    areas = np.abs(uv_areas(api.unwrap(obj, size=256, density_group="Face").uv))
    assert areas[:2].sum() / areas[2:].sum() == pytest.approx(4.0, rel=1e-3)


@pytest.mark.parametrize(
    "mesh", [replace(BOX, vertices=POINTS * 0.0), replace(BOX, triangles=TRIANGLES[:0]), 3, "nowhere.obj"]
)
def test_what_cannot_be_unwrapped_is_a_sentence(mesh):
    with pytest.raises(BakeError, match=r"\w+ .*\.$"):
        api.unwrap(mesh)
