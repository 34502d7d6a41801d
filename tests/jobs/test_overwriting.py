# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake in the window overwrites no file that the scene uses, and never writes two maps to one file."""

import os

import bpy
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_pair
from addon.output import map_names
from tests.support import scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def settings(output, **values):
    return Settings(method="FLATTEN", space="OBJECT", width=16, height=16, storage="FILE", output=str(output), **values)


def save(path):
    """An image of a single color."""
    image = bpy.data.images.new("shape", 4, 4)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    image.source, image.filepath = "FILE", str(path)
    return image


@pytest.mark.parametrize("output", ["shape.png", "./shape.png", "link.png", "hard.png", "SHAPE.png"])
def test_an_image_that_shapes_the_high_mesh_is_not_overwritten(tmp_path, output):
    low, high = zoo.plane("lo"), zoo.plane("hi", n=4)
    texture = bpy.data.textures.new("shape", "IMAGE")
    texture.image = save(tmp_path / "shape.png")
    high.modifiers.new("Displace", "DISPLACE").texture = texture
    if os.name != "nt":
        (tmp_path / "link.png").symlink_to("shape.png")
        os.link(tmp_path / "shape.png", tmp_path / "hard.png")
    before = (tmp_path / "shape.png").read_bytes()
    with pytest.raises(BakeError, match="overwrite the image 'shape'"):
        bake_pair(bpy.context, low, [high], settings(f"{tmp_path}/{output}"))
    assert (tmp_path / "shape.png").read_bytes() == before
    bake_pair(bpy.context, low, [high], settings(tmp_path / "map.png"))
    assert (tmp_path / "shape.png").read_bytes() == before


@pytest.mark.skipif(os.name == "nt", reason="links of POSIX")
@pytest.mark.parametrize("source", ["scene.blend", "library.blend"])
def test_links_to_the_open_file_and_to_libraries_are_recognized(tmp_path, source):
    zoo.plane("lo")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"), copy=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, linked_data):
        linked_data.objects = ["lo"]
    high = zoo.plane("hi")
    scenes.save(tmp_path / "scene.blend")
    (tmp_path / "map.png").symlink_to(source)
    with pytest.raises(BakeError, match="would overwrite (the open file|a linked library)"):
        bake_pair(bpy.context, bpy.data.objects[("lo", None)], [high], settings("//map.png"))


def jobs(*names):
    return [Job(zoo.plane(name), [zoo.plane(f"{name} high")]) for name in names]


@pytest.mark.parametrize(
    ("names", "output", "image", "message"),
    [
        (
            ("a", "b"),
            "map.png",
            "{low}",
            "The normal map of 'b' and the normal map of 'a' would both be '{here}/map.png': put",
        ),
        (("a/b", "a:b"), "{low}.png", "", "'{here}/a_b.png': rename one of the objects."),
        (("A", "a"), "{low}.png", "", "both fill the image 'a_normal': rename one"),
        (("a", "b"), "{low}.png", "Map", "both fill the image 'Map': put {low} into the name, or let them share it."),
    ],
)
def test_two_maps_with_the_same_file_or_image_raise_an_error_with_advice(tmp_path, names, output, image, message):
    with pytest.raises(BakeError) as refused:
        bake_all(bpy.context, jobs(*names), settings(tmp_path / output, image=image))
    assert message.replace("{here}", str(tmp_path)) in str(refused.value)
    assert os.listdir(tmp_path) == []


def test_letters_outside_ascii_stay_in_file_names(tmp_path):
    (job,) = jobs("Möbel 岩")
    (report,) = bake_all(bpy.context, [job], settings(tmp_path / "new" / "{low}.png", mask=True))
    names = [f"Möbel 岩{end}.png" for end in ("", "_missed")]
    assert report.output == [str(tmp_path / "new" / name) for name in names]
    assert sorted(os.listdir(tmp_path / "new")) == sorted(names)


def test_every_map_has_a_title():
    chosen = settings("m.png", mask=True, maps=("HEIGHT", "OBJECT_ID"), pack="GLTF")
    labels = [map_names.map_title(chosen.map, kind) for kind in map_names.settings_by_map(chosen)]
    assert labels == ["the normal map", "the miss mask", "the height map", "the object id map", "the packed map"]


def test_paths_in_a_library_are_relative_to_the_library(tmp_path):
    (tmp_path / "library").mkdir()
    texture = bpy.data.textures.new("shape", "IMAGE")
    texture.image = save(tmp_path / "library" / "shape.png")
    zoo.plane("hi", n=4).modifiers.new("Displace", "DISPLACE").texture = texture
    scenes.save(tmp_path / "library" / "library.blend")
    texture.image.filepath = "//shape.png"
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    low = zoo.plane("lo")
    scenes.save(tmp_path / "scene.blend")
    with bpy.data.libraries.load(str(tmp_path / "library" / "library.blend"), link=True) as (_, linked_data):
        linked_data.objects = ["hi"]
    bpy.context.scene.collection.objects.link(linked_data.objects[0])
    with pytest.raises(BakeError, match="overwrite the image 'shape'"):
        bake_pair(bpy.context, low, linked_data.objects, settings(tmp_path / "library" / "shape.png"))
    bake_pair(bpy.context, low, linked_data.objects, settings(tmp_path / "shape.png"))
