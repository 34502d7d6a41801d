# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the Python door: values of any type, meshes of any kind, and that the open file stays as it was."""

import json
import threading
from dataclasses import replace
from enum import StrEnum
from fractions import Fraction
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon import api
from addon.api import BakeError, Surface
from addon.core.settings import PART_OF
from addon.output import image_file
from tests.support import scenes, snapshot, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 16
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
LOW = Surface(POINTS, TRIANGLES, POINTS[:, :2])
HIGH = Surface(POINTS + [0.0, 0.0, 0.01] + np.outer(np.arange(4), [0.0, 0.0, 0.002]), TRIANGLES)

HUGE = 10**5000
"""Python refuses to write a number of so many digits."""
ODD = [
    *(np.float32(0.5), np.float64(2.0), np.int64(2), np.uint8(1), np.bool_(True), np.array(0.25), np.longdouble(0.5)),
    *(np.str_("x"), np.array([1, 2, 3]), np.array([0.5, 0.5, 1.0], np.float32), np.array(["a", "b"]), np.complex64(1)),
    *("x", "", "a\0b", "\ud800", b"x", None, True, 0, 1, -1, 1.5, 1e308, float("nan"), float("inf"), HUGE, -HUGE),
    *([1, 2, 3], [], {}, {"a": 1}, [[0.5, 0.5, 1.0]], [HUGE], [None], (np.float32(0.1),) * 3, {1001}, Fraction(1, 3)),
    *(object(), int, len, Path("a"), 1j, np.datetime64("2020-01-01"), bytearray(b"1"), range(3), iter("ab")),
]


def bake(low=LOW, high=HIGH, **values):
    return api.bake(low, high, **{"size": SIDE, "extrusion": 0.2, "max_distance": 0.4} | values)


def is_plain(value):
    """Whether a value is of the types that JSON and Blender's shaders take."""
    is_one = type(value) in (bool, int, float, str, type(None)) or isinstance(value, StrEnum)
    return is_one or (type(value) is tuple and all(map(is_plain, value)))


@pytest.mark.parametrize("name", sorted(PART_OF.keys() - {"maps", "output"}))
def test_a_setting_takes_a_value_of_any_type_or_names_itself(name):
    refused = 0
    for value in ODD:
        try:
            found = api._settings({"normal": "NORMAL"}, SIDE, "", {name: value}).flat()[name]
        except BakeError as error:
            refused += 1
            assert name.replace("_", "") in str(error).lower().replace("_", ""), value
        else:
            assert is_plain(found), (value, found)
    assert refused > len(ODD) / 2


NUMPY = {
    "samples": np.int64(4),
    "margin": np.int32(2),
    "extrusion": np.float32(0.25),
    "max_distance": np.array(0.5),
    "missed": np.float32([0.25, 0.5, 1.0]),
    "facing_only": np.bool_(True),
    "space": np.str_("object"),
    "targets": np.array(["unity", "unreal"]),
}


def test_numbers_of_numpy_are_those_of_python():
    plain = {name: value.tolist() for name, value in NUMPY.items()}
    one = bake(size=np.array([32, 16]), maps=np.array(["normal"]), **NUMPY)
    other = bake(size=(32, 16), **plain)
    assert one.maps["normal"].tobytes() == other.maps["normal"].tobytes()
    for report in (one.report, other.report):
        del report["settings"]["image"]  # a new name each time
    assert json.dumps(one.report["settings"]) == json.dumps(other.report["settings"])


WRONG = {
    "size": [None, "64", 64.0, True, HUGE, (16,), (16, 16, 16), (16, "x"), {}, np.array([[16, 16]]), 0],
    "maps": [None, 3, [3], [None], {"normal": 1}, np.array(2), b"normal", "nromal", ["normal", np.int64(1)], ()],
    "output": [None, 3, b"a.png", ["a.png"], "a\0.png", "a.xyz"],
    "on_progress": [3, "x"],
    **dict.fromkeys(("image", "storage", "width", "normal", "material", "texture_sets", "smaples"), [1]),
}


@pytest.mark.parametrize("name", WRONG)
def test_other_arguments_name_themselves(name):
    before = snapshot.snapshot()
    for value in WRONG[name]:
        with pytest.raises(BakeError) as caught:
            bake(**{name: value})
        assert name in str(caught.value) or isinstance(value, str) or value == (), value
    assert snapshot.difference(before, snapshot.snapshot()) == {}


def gone():
    obj = zoo.plane("gone")
    bpy.data.objects.remove(obj)
    return obj


MESHES = {
    "ragged triangles": lambda: replace(HIGH, triangles=[[0, 1, 2], [0, 2]]),
    "ragged vertices": lambda: replace(HIGH, vertices=[[0, 1, 2], [0, 2]]),
    "ragged normals": lambda: replace(HIGH, normals=[[0, 1, 2], [0, 2]]),
    "words": lambda: replace(HIGH, vertices="abc"),
    "nothing": lambda: replace(HIGH, vertices=None, triangles=None),
    "no triangles": lambda: replace(HIGH, triangles=np.zeros((0, 3), int)),
    "no vertices": lambda: Surface(np.zeros((0, 3)), np.zeros((0, 3), int)),
    "complex": lambda: replace(HIGH, vertices=POINTS * 1j),
    "beyond the vertices": lambda: replace(HIGH, triangles=TRIANGLES + 2**40),
    "a name that is none": lambda: replace(HIGH, name=3),
    "all NaN": lambda: replace(HIGH, vertices=POINTS * np.nan),
    "beyond single precision": lambda: replace(HIGH, vertices=POINTS * 1e300),
    "no file": lambda: "nowhere.obj",
    "no path": lambda: "a\0.obj",
    "an object that was deleted": gone,
    "a class": lambda: Surface,
    "bytes": lambda: b"a.obj",
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.filterwarnings("ignore:invalid value encountered in multiply")
def test_a_mesh_that_is_none_is_a_sentence(name):
    mesh = MESHES[name]()
    before = snapshot.snapshot()
    for given in (
        {"high": mesh},
        {"low": replace(mesh, uv=LOW.uv) if isinstance(mesh, Surface) else mesh},
        {"cage": mesh},
    ):
        with pytest.raises(BakeError, match=r"\w+ .*\.$"):
            bake(**given)
    assert snapshot.difference(before, snapshot.snapshot()) == {}


def test_a_thread_is_told_where_to_call_and_changes_nothing():
    before, said = snapshot.snapshot(), []

    def call():
        try:
            bake(low=LOW, high="nowhere.obj")
        except BakeError as error:
            said.append(str(error))

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    assert "main thread" in said[0] and "memory" not in said[0] and "nowhere" not in said[0]
    assert snapshot.difference(before, snapshot.snapshot()) == {}


@pytest.mark.parametrize(("ending", "depth"), [("png", 16), ("png", 8), ("tif", 16), ("exr", 16), ("exr", 32)])
def test_maps_are_as_their_files(ending, depth, tmp_path):
    half = replace(LOW, uv=LOW.uv * [0.4, 0.6])  # the rest has alpha 0
    found = bake(half, maps=["base-color", "normal"], output=tmp_path / f"m.{ending}", depth=depth, margin=1)
    files = [image_file.read(file) for file in found.files]
    for texels in found.maps.values():
        assert min(np.abs(texels - file).max() for file in files) < 1e-6


@pytest.mark.parametrize("name", ["base-color", "Base Color", "basecolor", "base_color", "BASE_COLOR"])
def test_a_map_has_the_name_that_was_asked_for(name):
    found = bake(maps=[name, "normal"]).maps
    assert list(found) == [name, "normal"]
    assert all(found[spelling] is found[name] for spelling in ("base_color", "BaseColor", "base-color"))
    with pytest.raises(KeyError):
        found["roughness"]


def test_what_the_caller_makes_meanwhile_stays():
    made = []

    def on_progress(progress):
        if not made:
            zoo.plane("mine")
            made.append(bake(maps="height"))  # a bake within, of which nothing stays
            bpy.data.worlds.new("mine")
            bpy.data.images.new("mine", 4, 4)

    before = snapshot.snapshot()
    bake(on_progress=on_progress)
    left = snapshot.difference(before, snapshot.snapshot())
    assert [bpy.data.objects.keys(), bpy.data.meshes.keys(), bpy.data.images.keys()] == [["mine"]] * 3
    assert "mine" in bpy.data.worlds
    assert left.keys() <= {"objects", "meshes", "images", "worlds", "active", ("object", "mine"), ("mesh", "mine")} | {
        key for key in left if key[0] in ("image", "Scene")
    }


def test_what_the_caller_makes_before_a_stop_stays():
    class StopError(Exception):
        pass

    def on_progress(progress):
        zoo.plane("mine")
        raise StopError

    with pytest.raises(StopError):
        bake(on_progress=on_progress)
    assert bpy.data.objects.keys() == bpy.data.meshes.keys() == ["mine"]


def bumpy(normals):
    """A high mesh of 8 x 8 squares with these normals by vertex (81, 3)."""
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    points = np.stack([x, y, 0.03 * np.sin(7 * x) * np.cos(5 * y)], -1).reshape(-1, 3)
    i = np.arange(81).reshape(9, 9)[:-1, :-1].ravel()
    return Surface(points, np.concatenate([np.c_[i, i + 1, i + 10], np.c_[i, i + 10, i + 9]]), normals=normals)


SMOOTH = 0.2
"""Of 255: what the angles of faces, in single and double precision, differ by."""


@pytest.mark.parametrize("length", [0.0, 1e-25])
def test_normals_without_a_length_are_smooth_and_told(length):
    smooth = bake(high=bumpy(None)).maps["normal"]
    result = bake(high=bumpy(np.tile([0.0, 0.6, length or 0.0], (81, 1)) * length))
    assert np.abs(result.maps["normal"] - smooth).max() * 255 < SMOOTH
    assert any("without a length" in warning for warning in result.warnings)
    some = np.tile([0.0, 0.0, 2.0], (81, 1))
    some[0] = 0.0
    result = bake(high=bumpy(some))
    assert any(warning.startswith("'high 1': 2 of its triangles have normals") for warning in result.warnings)
    assert np.abs(result.maps["normal"][8, 8, :3] - [0.5, 0.5, 1.0]).max() < 1e-6
    assert bake(high=bumpy(np.tile([0.0, 0.0, 1e-6], (81, 1)))).warnings != result.warnings


def test_a_low_mesh_of_normals_without_a_length():
    zero = replace(LOW, normals=np.zeros((4, 3)))
    result = bake(low=zero, high=bumpy(None))
    assert np.abs(result.maps["normal"] - bake(high=bumpy(None)).maps["normal"]).max() * 255 < SMOOTH
    assert any(warning.startswith("'low': 2 of its triangles have normals") for warning in result.warnings)


def rigged(folder):
    """Files of all kinds of an animated armature's mesh, in a scene with other frames, units and a world."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    low = zoo.plane("part", n=2)
    data = bpy.data.armatures.new("rig")
    rig = bpy.data.objects.new("rig", data)
    scene = bpy.context.scene
    scene.collection.objects.link(rig)
    scenes.select(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    data.edit_bones.new("bone").tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    low.parent, low.modifiers.new("Armature", "ARMATURE").object = rig, rig
    scenes.weigh(low, "bone", 1.0)
    for frame in (3, 9):
        rig.location.x = frame / 100
        rig.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end, scene.render.fps = 3, 9, 30
    scene.world = bpy.data.worlds.new("sky")
    scenes.select(low, rig)
    files = {
        kind: str(folder / f"part.{kind}")
        for kind in ("usdc", "usda", "usdz", "fbx", "glb", "gltf", "obj", "ply", "stl", "blend")
    }
    for kind in ("usdc", "usda", "usdz"):
        bpy.ops.wm.usd_export(filepath=files[kind], export_animation=True)
    bpy.ops.export_scene.fbx(filepath=files["fbx"])
    bpy.ops.export_scene.gltf(filepath=files["glb"])
    bpy.ops.export_scene.gltf(filepath=files["gltf"], export_format="GLTF_SEPARATE")
    tree = json.loads(Path(files["gltf"]).read_text())
    tree["scenes"].append({"name": "other", "nodes": []})
    tree["scenes"][0]["extras"] = {"note": 1}
    variants = {"KHR_materials_variants": {"variants": [{"name": "red"}]}}
    Path(files["gltf"]).write_text(json.dumps(tree | {"extensions": variants, "extensionsUsed": list(variants)}))
    bpy.ops.wm.obj_export(filepath=files["obj"])
    bpy.ops.wm.ply_export(filepath=files["ply"])
    bpy.ops.wm.stl_export(filepath=files["stl"])
    scenes.save(Path(files["blend"]))
    bpy.ops.import_scene.gltf(
        filepath=files["gltf"]
    )  # with the first file of variants, all meshes get properties of these
    return files


@pytest.fixture(scope="module")
def files(tmp_path_factory, gpu_context):
    return rigged(tmp_path_factory.mktemp("files"))


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize("kind", ["usdc", "usda", "usdz", "fbx", "glb", "gltf", "obj", "ply", "stl", "blend"])
def test_a_file_leaves_the_open_scene_alone(kind, mode, files):
    one, other, hidden = (zoo.plane(name) for name in ("one", "other", "hidden"))
    scene = bpy.context.scene
    for name in ("red", "blue"):
        scene.collection.children.link(bpy.data.collections.new(name))
    bpy.data.collections["red"].objects.link(hidden)
    layer = bpy.context.view_layer
    layer.layer_collection.children["red"].exclude = True
    layer.active_layer_collection = layer.layer_collection.children["blue"]
    scene.frame_start, scene.frame_end, scene.render.fps, scene.unit_settings.scale_length = 20, 40, 25, 0.01
    scene.frame_set(31, subframe=0.5)
    scene.world, scene.cursor.location = bpy.data.worlds.new("mine"), (1, 2, 3)
    scenes.select(one, other)
    if mode == "EDIT":
        bpy.ops.object.mode_set(mode="EDIT")

    def state():
        layers = snapshot.settings(layer), layer.active_layer_collection.name, bpy.context.mode
        parts = [
            snapshot.settings(part) for part in (scene.unit_settings, scene.cursor, scene.tool_settings, scene.render)
        ]
        windows = [(window.scene.name, window.view_layer.name) for window in bpy.context.window_manager.windows]
        return snapshot.snapshot() | {"more": (layers, parts, windows, list(scene.keys()), scene.frame_subframe)}

    before = state()
    assert bake(high=files[kind], extrusion=0.5, max_distance=1.0).maps["normal"].any()
    assert snapshot.difference(before, state()) == {}
