# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests wrong input: the message is one sentence with the cause and the fix, and nothing is changed or written.

Input that is partly valid is baked, and the rest is counted.
"""

import os
import re

import bpy
import gpu
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import bake_pair
from tests.support import maps, scenes, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

SMALL = {"method": "FLATTEN", "width": 32, "height": 32}


def is_one_sentence(text):
    return text.endswith(".") and "\n" not in text and not re.search(r"[.!?]\s", text)


@pytest.fixture
def pair():
    """A low and a high object in a scene with settings and datablocks that a bake could change."""
    low, high, other = zoo.plane("lo"), zoo.terrain("hi"), zoo.cube("other")
    other.modifiers.new("Rounded", "SUBSURF").levels = 0
    other.hide_render = True
    other.select_set(True)
    low.select_set(True)
    bpy.context.view_layer.objects.active = other
    scenes.material("Skin", low)
    render = bpy.context.scene.render
    render.engine, render.image_settings.color_depth, render.filepath = "CYCLES", "16", "//frame_"
    image = bpy.data.images.new("lo_normal", 8, 4)
    image.pixels.foreach_set(np.linspace(0, 1, 8 * 4 * 4, dtype=np.float32))
    return low, high


def refusal(low, highs, **settings):
    """The message of a bake that must be refused without changing anything."""
    before = snapshot()
    with pytest.raises(BakeError) as refused:
        bake_pair(bpy.context, low, highs, Settings(**SMALL | settings))
    assert difference(before, snapshot()) == {}
    message = str(refused.value)
    assert is_one_sentence(message), message
    return message


def remove_uvs(obj):
    obj.data.uv_layers.remove(obj.data.uv_layers[0])


def empty_through_modifiers(obj):
    obj.vertex_groups.new(name="none")
    obj.modifiers.new("Mask", "MASK").vertex_group = "none"


def child_of_flat_parent(obj):
    """The matrix has no zeros, only because of rounding."""
    parent = scenes.link(bpy.data.objects.new("flat", None))
    parent.scale.z, parent.rotation_euler = 0.0, (1.0, 2.0, 3.0)
    obj.parent, obj.rotation_euler = parent, (0.4, 0.5, 0.6)


# Objects

SPOILED = {  # a change to an object, and the word in the message about the fix
    "no UV layer": (remove_uvs, "unwrap"),
    "no faces": (lambda obj: obj.data.clear_geometry(), "no faces"),
    "in no scene": (lambda obj: obj.users_scene[0].collection.objects.unlink(obj), "link it"),
    "zero scale": (lambda obj: setattr(obj, "scale", (0, 0, 0)), "scale"),
    "zero scale along an axis": (lambda obj: setattr(obj, "delta_scale", (1, 0, 1)), "scale"),
    "zero scale of a parent": (child_of_flat_parent, "scale"),
    "NaN in the matrix": (lambda obj: setattr(obj.scale, "x", float("nan")), "NaN"),
}


@pytest.mark.parametrize("name", ["lo", "hi"])
@pytest.mark.parametrize("case", SPOILED)
def test_the_message_names_the_object_and_the_fix(pair, name, case):
    low, high = pair
    spoil, remedy = SPOILED[case]
    spoil(bpy.data.objects[name])
    message = refusal(low, [high])
    assert repr(name) in message
    assert remedy in message


KINDS = [(kind, "low") for kind in ("LIGHT", "EMPTY", "CURVE", "FONT")] + [
    (kind, "high") for kind in ("LIGHT", "EMPTY")
]


@pytest.mark.parametrize(("kind", "role"), KINDS)
def test_objects_without_a_surface_are_refused(pair, kind, role):
    low, high = pair
    data = {
        "LIGHT": lambda: bpy.data.lights.new("odd", "SUN"),
        "EMPTY": lambda: None,
        "CURVE": lambda: bpy.data.curves.new("odd", "CURVE"),
        "FONT": lambda: bpy.data.curves.new("odd", "FONT"),
    }[kind]()
    odd = scenes.link(bpy.data.objects.new("odd", data))
    message = refusal(*((odd, [high]) if role == "low" else (low, [odd])))
    assert "'odd'" in message
    assert "mesh" in message


def test_a_high_mesh_that_modifiers_make_empty(pair):
    low, high = pair
    empty_through_modifiers(high)
    assert "'hi' has no faces" in refusal(low, [high])


def test_a_named_uv_layer_that_the_low_mesh_lacks(pair):
    low, high = pair
    message = refusal(low, [high], uv_layer="Lightmap")
    assert "'lo'" in message
    assert "'Lightmap'" in message
    assert repr(zoo.LAYER) in message  # the existing layer


def test_a_low_object_among_several_high_ones(pair):
    low, high = pair
    assert "'lo' is both the low object and one of several high objects" in refusal(low, [high, low])


def test_a_high_object_that_is_given_twice(pair):
    low, high = pair
    assert "'hi' is twice in the high objects" in refusal(low, [high, high])


def test_no_high_object(pair):
    low, _ = pair
    assert "No high object for 'lo'" in refusal(low, [])


def linked(tmp_path, *names):
    """Save the current scene as a library, and link the objects with these names from it."""
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = list(names)
    return [scenes.link(obj) for obj in wanted.objects]


def test_a_linked_low_object(pair, tmp_path):
    _, high = pair
    (low,) = linked(tmp_path, "lo")
    message = refusal(low, [high])
    assert '"lo" is linked from a library' in message
    assert "make it local" in message


def test_a_mesh_in_edit_mode_in_another_scene(pair):
    low, _ = pair
    elsewhere = bpy.data.scenes.new("Elsewhere")
    twin = low.copy()
    twin.modifiers.new("Rounded", "SUBSURF")
    elsewhere.collection.objects.link(twin)
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.window.scene = elsewhere
    assert f"The mesh of {twin.name!r} is in Edit Mode" in refusal(twin, [twin])


# Settings

SETTINGS = {
    "size 0": ({"width": 0, "height": 0}, "Width: 0 is"),
    "size 15": ({"width": 16, "height": 15}, "Height: 15 is"),
    "size 20000": ({"width": 20000, "height": 16}, "16384"),
    "negative size": ({"width": -64}, "-64"),
    "negative margin": ({"margin": -1}, "-1"),
    "huge margin": ({"margin": 100000}, "100000"),
    "depth": ({"depth": 24}, "24"),
    "space": ({"space": "CAMERA"}, "'CAMERA'"),
    "method": ({"method": "GUESS"}, "'GUESS'"),
    "green": ({"green": "y"}, "'y'"),
    "no file": ({"storage": "FILE"}, "No file is set"),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_settings_that_are_not_valid(pair, case):
    low, high = pair
    settings, word = SETTINGS[case]
    assert word in refusal(low, [high], **settings)


def test_a_map_that_is_too_wide_for_the_gpu(pair, monkeypatch):
    low, high = pair
    monkeypatch.setattr(gpu.capabilities, "max_texture_size_get", lambda: 1024)
    message = refusal(low, [high], width=2048)
    assert "2048" in message
    assert "1024" in message


def test_no_gpu(pair, monkeypatch):
    def fail():
        raise SystemError("no context")

    low, high = pair
    monkeypatch.setattr(gpu, "init", fail)
    assert "no GPU" in refusal(low, [high])


# Output

OUTPUTS = {
    "name too long in a missing folder": ("none/" + "m" * 300 + ".png", 16, "too long"),
    "folder": ("folder.png", 16, "is a folder"),
    "file in place of a folder": ("file.txt/map.png", 16, "Not a directory"),
    "name too long": ("m" * 300 + ".png", 16, "too long"),
    "no image format": ("map.bmp", 8, "one of .png, .exr"),
    "no ending": ("map", 8, "one of .png, .exr"),
    "PNG in 32 bits": ("map.png", 32, "8 or 16 bits"),
    "OpenEXR in 8 bits": ("map.exr", 8, "16 or 32 bits"),
}


@pytest.mark.parametrize("case", OUTPUTS)
def test_a_file_that_cannot_be_written(pair, tmp_path, case):
    low, high = pair
    name, depth, word = OUTPUTS[case]
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file.txt").touch()
    before = sorted(tmp_path.rglob("*"))
    assert word in refusal(low, [high], storage="FILE", output=str(tmp_path / name), depth=depth)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_path_relative_to_a_file_that_was_never_saved(pair, tmp_path, monkeypatch):
    low, high = pair
    monkeypatch.chdir(tmp_path)  # Blender would resolve the path here
    assert "save it first" in refusal(low, [high], storage="FILE", output="//map.png")
    assert os.listdir(tmp_path) == []


def of_source(source):
    bpy.data.images.new("taken", 8, 8).source = source


def render():
    """Render an empty picture of 4 x 4 pixels."""
    scene = bpy.context.scene
    scene.camera = scenes.link(bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera")))
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.cycles.samples = 1
    bpy.ops.render.render()
    return bpy.data.images["Render Result"]


def rendered():
    render().name = "taken"


def layered():
    """A file with the layers of a render."""
    result, scene, path = render(), bpy.context.scene, os.path.join(bpy.app.tempdir, "layers.exr")
    scene.render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    result.save_render(path, scene=scene)
    image = bpy.data.images.load(path)
    image.name = "taken"
    assert (len(image.pixels), image.type) == (0, "MULTILAYER")  # the type is set when the file is read


TAKEN = {
    "movie": lambda: of_source("MOVIE"),
    "sequence": lambda: of_source("SEQUENCE"),
    "stereo": lambda: bpy.data.images.new("taken", 8, 8, stereo3d=True),
    "render result": rendered,
    "layers": layered,
}


@pytest.mark.parametrize("storage", ["PACK", "MEMORY", "FILE"])
@pytest.mark.parametrize("case", TAKEN)
def test_an_image_that_is_not_a_still_image_is_not_replaced(pair, tmp_path, case, storage):
    low, high = pair
    TAKEN[case]()
    message = refusal(low, [high], image="taken", storage=storage, output=str(tmp_path / "map.png"))
    assert "'taken'" in message
    assert "another name" in message
    assert os.listdir(tmp_path) == []


# Coordinates


def poke(attribute, values):
    """Set some elements of a vector attribute: {index: vector}. Setting single elements would clamp infinity."""
    width = len(attribute.data[0].vector)
    array = np.empty((len(attribute.data), width), np.float32)
    attribute.data.foreach_get("vector", array.ravel())
    for index, value in values.items():
        array[index] = value
    attribute.data.foreach_set("vector", array.ravel())


def set_uv(obj, values):
    """Set the UVs of some corners: {corner: (u, v)}."""
    poke(obj.data.attributes[zoo.LAYER], values)


def set_position(obj, vertex, value):
    poke(obj.data.attributes["position"], {vertex: value})
    obj.data.update()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("what", ["position", "uv"])
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
def test_triangles_that_are_not_finite_are_left_out_and_counted(pair, bad, what, space):
    low, high = pair
    if what == "position":
        set_position(high, 40, (bad, 0, 0))
    else:
        set_uv(high, {0: (0.5, bad)})
    report = bake_pair(bpy.context, low, [high], Settings(**SMALL, space=space))
    # A corner of a quad is in one or two of its triangles; a vertex in the middle of quads is in 4 to 8, and infinity
    # makes the normals of its neighbors invalid too.
    (counted,) = (int(n) for w in report.warnings for n in re.findall(r"'hi': (\d+) of its triangles are left out", w))
    assert counted in (range(1, 3) if what == "uv" else range(4, 9))
    assert report.triangles["high"] == 2 * 32 * 32 - counted
    assert np.isfinite(maps.pixels(bpy.data.images["lo_normal"])).all()
    assert 0.9 < report.coverage < 1.0


def test_uvs_outside_the_tile_are_counted_and_named(pair):
    low, high = pair
    set_uv(high, {4 * 500: (1.5, 0.1)})
    report = bake_pair(bpy.context, low, [high], Settings(**SMALL))
    (warning,) = report.warnings
    assert re.match(r"'hi': [12] of its triangles reach outside the UV tile", warning)


def test_triangles_without_area_in_uv_space_are_counted_and_named(pair):
    low, high = pair
    set_uv(high, {4 * 7 + corner: (0.25, 0.25) for corner in range(4)})
    report = bake_pair(bpy.context, low, [high], Settings(**SMALL))
    assert any(re.match(r"'hi': 2 of its triangles have no area", warning) for warning in report.warnings)


METHODS = ["FLATTEN", "CAST", "AUTO"]


def fill(name, attribute, value):
    data = bpy.data.objects[name].data
    values = data.attributes[attribute].data
    values.foreach_set("vector", np.full(len(values) * len(values[0].vector), value, np.float32))
    data.update()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["lo", "hi"])
def test_a_mesh_without_a_finite_point_is_named(pair, name, method):
    low, high = pair
    fill(name, "position", np.nan)
    message = refusal(low, [high], method=method)
    assert repr(name) in message
    assert "NaN" in message


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
@pytest.mark.parametrize("name", ["lo", "hi"])
def test_a_mesh_that_is_one_point_gives_finite_texels_or_a_message(pair, name, space, method):
    low, high = pair
    fill(name, "position", 0.5)
    try:
        assert np.isfinite(maps.bake(low, high, space=space, method=method, size=(32, 32))).all()
    except BakeError as error:
        assert method != "FLATTEN"
        assert is_one_sentence(str(error))


@pytest.mark.parametrize(("name", "place"), [("hi", 0.5), ("lo", 1.2)])
def test_the_message_names_the_mesh_that_has_no_area(pair, name, place):
    low, high = pair
    fill(name, "position", place)
    message = refusal(low, [high], method="CAST", max_distance=2.0, extrusion=0.1)
    assert message == f"All faces of {name!r} are points or lines without an area: no ray can meet them."


def test_nan_does_not_hide_uvs_outside_the_tile(pair):
    low, high = pair
    set_uv(high, {0: (np.nan, 0.0), 4 * 500: (1.5, 0.5)})
    report = bake_pair(bpy.context, low, [high], Settings(**SMALL))
    assert any("outside the UV tile" in warning for warning in report.warnings)


def test_rounding_is_not_outside_the_tile(pair):
    low, high = pair
    high.modifiers.new("Rounded", "SUBSURF")
    report = bake_pair(bpy.context, low, [high], Settings(**SMALL))
    assert report.warnings == []


@pytest.mark.parametrize("name", ["hi", "lo"])
def test_the_message_names_the_mesh_that_is_not_on_the_map(pair, name):
    low, high = pair
    data = bpy.data.objects[name].data
    data.uv_layers[0].uv.foreach_set("vector", np.full(len(data.loops) * 2, 2.0, np.float32))
    message = refusal(low, [high])
    assert name in re.findall(r"\w+", message)
    assert {"lo": "hi", "hi": "lo"}[name] not in re.findall(r"\w+", message)
