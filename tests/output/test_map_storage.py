# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the pixels of images in memory, packed and in files of every format, and that failures keep the old ones."""

import os
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.output import atomic_file, datablocks, image_file, outputs
from addon.output.write_queue import Content
from tests.support import scenes, zoo
from tests.support.maps import pixels
from tests.support.snapshot import difference, snapshot

ROUNDING = 1e-6
"""The error of single precision, in addition to the quantization of the formats below."""
EXACT = 0.0
STEP_8, STEP_16 = 0.5 / 255, 0.5 / 65535
"""Half a step of integers."""
STEP_HALF = 2**-12
"""Half a step of 16-bit floats between 0.5 and 1: they have 11 significant bits."""

WIDTH, HEIGHT = 40, 24
FLAT = (0.5, 0.5, 1.0, 0.0)
"""Background: the flat normal with alpha 0."""
FORMATS = {
    ("map.png", 8): STEP_8,
    ("map.png", 16): STEP_16,
    ("map.tif", 8): STEP_8,
    ("map.tiff", 16): STEP_16,
    ("map.tga", 8): STEP_8,
    ("map.exr", 16): STEP_HALF,
    ("map.exr", 32): EXACT,
}


@pytest.fixture
def texels():
    return some_texels()


def some_texels(width=WIDTH, height=HEIGHT, seed=1):
    """Noise with some background. All rows and columns are different."""
    random = np.random.default_rng(seed)
    result = random.random((height, width, 4), dtype=np.float32)
    result[..., 3] = 1.0
    result[random.random((height, width)) > 0.7] = FLAT
    return result


def store(texels, **settings):
    height, width = texels.shape[:2]
    settings = Settings(width=width, height=height, **settings)
    outputs.check_storage("low", settings)
    with outputs.MapWriter("low", settings) as writer:
        writer.add(1001, texels)
        return writer.commit()


def assert_texels(image, texels, step):
    """The pixels are the texels, with the colors where alpha is 0. Those are as flat as the format allows."""
    found = pixels(image)
    assert found.shape == texels.shape
    np.testing.assert_allclose(found, texels, rtol=0, atol=step + ROUNDING)
    assert set(np.unique(found[..., 3])) == {0.0, 1.0}
    np.testing.assert_allclose(found[found[..., 3] == 0][:, :3], [FLAT[:3]] * (found[..., 3] == 0).sum(), atol=step)


def assert_is_data(image):
    assert image.colorspace_settings.name == "Non-Color"
    assert image.alpha_mode == "CHANNEL_PACKED"
    assert not image.use_half_precision


def save_and_reload(tmp_path):
    """Save the scene and open it; return the map's image."""
    path = str(tmp_path / "scene.blend")
    scenes.save(path)
    bpy.ops.wm.open_mainfile(filepath=path)
    return bpy.data.images["low_normal"]


# New images


@pytest.mark.parametrize(("depth", "step"), [(8, STEP_8), (16, EXACT), (32, EXACT)])
@pytest.mark.parametrize("storage", ["PACK", "MEMORY"])
def test_a_new_image_has_the_texels(texels, storage, depth, step):
    image = store(texels, storage=storage, depth=depth)
    assert image.name == "low_normal"
    assert_texels(image, texels, step)
    assert_is_data(image)
    assert image.is_float == (depth > 8)
    assert (image.packed_file is not None) == (storage == "PACK")
    assert len(bpy.data.images) == 1


@pytest.mark.parametrize(("depth", "step"), [(8, STEP_8), (16, EXACT), (32, EXACT)])
def test_a_packed_image_survives_saving(texels, depth, step, tmp_path):
    store(texels, storage="PACK", depth=depth)
    image = save_and_reload(tmp_path)
    assert_texels(image, texels, step)
    assert_is_data(image)


# Files


@pytest.mark.parametrize(("name", "depth"), FORMATS)
def test_a_file_has_the_texels(texels, name, depth, tmp_path):
    path = tmp_path / name
    image = store(texels, storage="FILE", output=str(path), depth=depth)
    for found in (image, bpy.data.images.load(str(path), check_existing=False)):
        # A new image that is only set to Non-Color reads the file unchanged, as other programs do.
        found.colorspace_settings.name = "Non-Color"
        found.alpha_mode = "CHANNEL_PACKED"
        assert_texels(found, texels, FORMATS[name, depth])
        assert found.is_float == (depth > 8)
    assert_is_data(image)
    assert (image.source, image.filepath, image.packed_file) == ("FILE", str(path), None)
    assert os.listdir(tmp_path) == [name]


def test_scene_settings_do_not_touch_the_file(texels, tmp_path):
    view = bpy.context.scene.view_settings
    view.view_transform, view.exposure, view.gamma = "AgX", 2.0, 2.0
    bpy.context.scene.render.image_settings.compression = 100
    store(texels, storage="FILE", output=str(tmp_path / "map.exr"), depth=32)
    found = bpy.data.images.load(str(tmp_path / "map.exr"))
    found.colorspace_settings.name, found.alpha_mode = "Non-Color", "CHANNEL_PACKED"
    assert_texels(found, texels, EXACT)


def test_a_path_relative_to_the_saved_scene(texels, tmp_path):
    scenes.save(tmp_path / "scene.blend")
    image = store(texels, storage="FILE", output="//map.png")
    assert (tmp_path / "map.png").is_file()
    assert image.filepath == "//map.png"
    assert_texels(image, texels, STEP_16)


def test_names_may_be_as_long_as_the_file_system_takes(texels, tmp_path):
    path = tmp_path / ("m" * 251 + ".png")
    store(texels, storage="FILE", output=str(path))
    assert os.listdir(tmp_path) == [path.name]


def test_a_file_is_replaced(texels, tmp_path):
    path = tmp_path / "map.png"
    path.write_bytes(b"an old picture")
    os.link(path, tmp_path / "witness.png")
    store(texels, storage="FILE", output=str(path))
    # A program that has the old file open keeps its content.
    assert (tmp_path / "witness.png").read_bytes() == b"an old picture"
    assert path.read_bytes().startswith(b"\x89PNG")


def test_the_image_shows_the_new_file(texels, tmp_path):
    """When an artist bakes again."""
    path, other = str(tmp_path / "map.png"), some_texels(seed=2)
    store(texels, storage="FILE", output=path)
    assert_texels(store(other, storage="FILE", output=path), other, STEP_16)


def test_texels_may_change_when_they_were_added(texels, tmp_path):
    """Threads write what they were, so that the caller can draw the next map over them."""
    settings = Settings(width=WIDTH, height=HEIGHT, storage="FILE", output=str(tmp_path / "map.png"))
    drawn = texels.copy()
    with outputs.MapWriter("low", settings) as writer:
        writer.add(1001, drawn)
        drawn[:] = 0.25
        assert_texels(writer.commit(), texels, STEP_16)


@pytest.mark.parametrize("name", [name for name, _ in FORMATS])
def test_a_file_is_not_read_back_until_the_image_is_looked_at(texels, name, tmp_path):
    depth = next(depth for known, depth in FORMATS if known == name)
    for _ in range(2):  # a new image, and one that was loaded
        image = store(texels, storage="FILE", output=str(tmp_path / name), depth=depth)
        assert (image.has_data, image.is_dirty) == (False, False)
        assert_texels(image, texels, FORMATS[name, depth])
        assert image.has_data


def test_what_is_discarded_while_it_is_written_leaves_nothing(tmp_path, monkeypatch):
    """Whatever was done of it."""
    begun, texels = threading.Event(), some_texels(300, 200)
    real = image_file.content

    def slow(*args, **options):
        made = real(*args, **options)

        def part():
            begun.set()
            time.sleep(0.05)
            return made.parts[0]()

        return Content([part, *made.parts[1:]], made.write)

    monkeypatch.setattr(image_file, "content", slow)
    settings = Settings(width=300, height=200, storage="FILE", output=str(tmp_path / "new" / "map.png"))
    with outputs.MapWriter("low", settings) as writer:
        writer.add(1001, texels)
        assert begun.wait(10)
        assert len(os.listdir(tmp_path / "new")) == 2  # with the guard
    assert os.listdir(tmp_path) == []
    assert not bpy.data.images


@pytest.fixture
def full_disk():
    """A function that limits the bytes of each file in a `with` block."""
    resource = pytest.importorskip("resource")

    @contextmanager
    def limit(taken):
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (taken, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limit


@pytest.mark.parametrize(("name", "depth"), FORMATS)
def test_a_full_disk_leaves_the_old_file_and_image(name, depth, tmp_path, full_disk):
    """Wherever the file is cut: at the start, in its header, in the last block, before the last byte."""
    texels, path = some_texels(100, 60), tmp_path / name
    store(texels, storage="FILE", output=str(path), depth=depth, image="whole")
    size = path.stat().st_size
    path.write_bytes(b"an old picture")
    bpy.data.images.new("low_normal", 4, 4).pixels[0] = 0.25
    before = snapshot()
    for taken in (0, 8, 300, size // 2, size - 5000, size - 600, size - 30, size - 1):
        with full_disk(taken), pytest.raises(BakeError) as refused:
            store(texels, storage="FILE", output=str(path), depth=depth)
        message = str(refused.value)
        assert message.startswith(f"{str(path)!r} could not be written: ")
        assert message.endswith(".")
        assert "\n" not in message
        assert "Error:" not in message
        assert path.read_bytes() == b"an old picture"
        assert os.listdir(tmp_path) == [name]
        assert difference(before, snapshot()) == {}
    store(texels, storage="FILE", output=str(path), depth=depth)
    assert path.stat().st_size == size


def test_a_file_that_cannot_be_moved_into_place_leaves_the_old_one(texels, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(13, "Permission denied")

    path = tmp_path / "map.png"
    path.write_bytes(b"an old picture")
    before = snapshot()
    monkeypatch.setattr(atomic_file.os, "replace", fail)
    with pytest.raises(BakeError) as refused:
        store(texels, storage="FILE", output=str(path))
    assert str(refused.value) == f"{str(path)!r} could not be written: Permission denied."
    assert path.read_bytes() == b"an old picture"
    assert os.listdir(tmp_path) == ["map.png"]
    assert difference(before, snapshot()) == {}


def test_a_second_file_that_cannot_be_moved_into_place_leaves_the_first_one(texels, tmp_path, monkeypatch):
    paths, replace = [tmp_path / "first.png", tmp_path / "second.png"], atomic_file.os.replace

    def fail(source, target):
        if Path(target) == paths[1]:
            raise OSError(13, "Permission denied")
        replace(source, target)

    for path in paths:
        path.write_bytes(b"an old picture")
    before = snapshot()
    made = [Settings(width=WIDTH, height=HEIGHT, image=path.stem, storage="FILE", output=str(path)) for path in paths]
    with outputs.MapWriter("", made[0]) as first, outputs.MapWriter("", made[1]) as second:
        for writer in (first, second):
            writer.add(1001, texels.copy())
        monkeypatch.setattr(atomic_file.os, "replace", fail)
        with pytest.raises(BakeError, match=r"second\.png' could not be written: Permission denied"):
            outputs.commit_all([first, second])
        monkeypatch.undo()
    assert [path.read_bytes() for path in paths] == [b"an old picture"] * 2
    assert sorted(os.listdir(tmp_path)) == ["first.png", "second.png"]
    assert difference(before, snapshot()) == {}


# Existing images


def opaque_file(tmp_path, mode="RGB", ending=".png"):
    """An image datablock of a file without alpha."""
    scene, path = bpy.context.scene, str(tmp_path / f"old{ending}")
    source = bpy.data.images.new("source", 16, 16)
    scene.render.image_settings.file_format = {".png": "PNG", ".jpg": "JPEG"}[ending]
    scene.render.image_settings.color_mode = mode
    source.save_render(path, scene=scene)
    bpy.data.images.remove(source)
    return bpy.data.images.load(path)


def missing_file():
    image = bpy.data.images.new("missing", 8, 8)
    image.filepath, image.source = "//nowhere.png", "FILE"
    return image


OLD = {
    "opaque": lambda _: bpy.data.images.new("old", 8, 8),
    "opaque, of the same size": lambda _: bpy.data.images.new("old", WIDTH, HEIGHT),
    "half float": lambda _: bpy.data.images.new("old", WIDTH, HEIGHT, alpha=True, float_buffer=True),
    "checker": lambda _: bpy.data.images.new("old", 8, 8, alpha=True),
    "sRGB file": opaque_file,
    "gray file": lambda folder: opaque_file(folder, mode="BW"),
    "JPEG file": lambda folder: opaque_file(folder, ending=".jpg"),
    "missing file": lambda _: missing_file(),
}


@pytest.fixture(params=OLD)
def old(request, tmp_path):
    """An image with the map's name that a material uses, marked as color with premultiplied alpha."""
    image = OLD[request.param](tmp_path)
    image.name = "low_normal"
    image.generated_type = "UV_GRID" if request.param == "checker" else image.generated_type
    image.use_half_precision, image.alpha_mode = True, "PREMUL"
    image["note"] = "keep"
    material = bpy.data.materials.new("user")
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image
    material.use_fake_user = True
    return image


def user_of_image():
    nodes = bpy.data.materials["user"].node_tree.nodes
    return next(node.image for node in nodes if node.bl_idname == "ShaderNodeTexImage")


@pytest.mark.parametrize(("storage", "depth", "step"), [("PACK", 8, STEP_8), ("MEMORY", 32, EXACT)])
def test_an_existing_image_is_filled(texels, old, storage, depth, step):
    image = store(texels, storage=storage, depth=depth)
    assert image == old == user_of_image()
    assert image["note"] == "keep"
    assert len(bpy.data.images) == 1
    assert_texels(image, texels, step)
    assert_is_data(image)
    assert image.is_float == (depth > 8)


@pytest.mark.parametrize(("depth", "step"), [(8, STEP_8), (32, EXACT)])
@pytest.mark.usefixtures("old")
def test_an_existing_image_is_packed_with_alpha(texels, depth, step, tmp_path):
    store(texels, storage="PACK", depth=depth)
    image = save_and_reload(tmp_path)
    assert image == user_of_image()
    assert_texels(image, texels, step)
    assert_is_data(image)


def test_an_opaque_image_of_colors_is_packed_with_alpha(texels):
    """Blender drops the pixels of an image when its color space changes."""
    bpy.data.images.new("colors", 4, 4, alpha=False)
    datablocks.fill("colors", texels, is_float=False, pack=True, color_space="sRGB")
    assert_texels(bpy.data.images["colors"], texels, STEP_8)


@pytest.mark.parametrize(
    ("old", "name", "depth"),
    [*((old, "map.png", 8) for old in OLD), *(("sRGB file", *each) for each in FORMATS)],
    indirect=["old"],
)
def test_an_existing_image_shows_the_file(texels, old, name, depth, tmp_path):
    image = store(texels, storage="FILE", output=str(tmp_path / name), depth=depth)
    assert image == old == user_of_image()
    assert_texels(image, texels, FORMATS[name, depth])
    assert_is_data(image)
    again = save_and_reload(tmp_path)
    assert_texels(again, texels, FORMATS[name, depth])


def test_one_image_can_change_storage_size_and_depth(tmp_path):
    steps = [("PACK", depth, "", STEP_8 if depth == 8 else EXACT) for depth in (8, 16, 32)]
    steps += [("MEMORY", depth, "", STEP_8 if depth == 8 else EXACT) for depth in (8, 16, 32)]
    steps += [("FILE", depth, str(tmp_path / name), step) for (name, depth), step in FORMATS.items()]
    first = None
    for turn in range(60):
        storage, depth, output, step = steps[(turn * 7) % len(steps)]  # 7 and 13 are coprime: other pairs in a row
        width, height = ((16, 16), (24, 16), (24, 40))[turn // 2 % 3]  # each size twice in a row
        texels = some_texels(width, height, seed=turn)
        image = store(texels, storage=storage, depth=depth, output=output)
        first = first or image
        assert image == first
        assert_texels(image, texels, step)
        assert_is_data(image)
        assert (image.packed_file is not None) == (storage == "PACK")
        assert image.is_float == (depth > 8)
    assert len(bpy.data.images) == 1


def test_a_linked_image_of_the_same_name_does_not_change(texels, tmp_path):
    bpy.data.images.new("low_normal", 4, 4).use_fake_user = True
    path = str(tmp_path / "library.blend")
    scenes.save(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.images = ["low_normal"]
    (linked,) = wanted.images
    image = store(texels, storage="MEMORY")
    assert image.library is None
    assert tuple(linked.size) == (4, 4)
    assert_texels(image, texels, EXACT)


@pytest.mark.usefixtures("gpu_context")
def test_an_object_with_the_longest_name_has_one_image():
    """Blender shortens long names. An image that is not found by its name would be made again at each bake."""
    names = ["\u00e9" * 120 + end for end in ("one", "two")]
    high = zoo.plane("high")
    found = set()
    for name in names:
        low = zoo.plane(name)
        for _ in range(2):
            settings = Settings(method="FLATTEN", width=16, height=16, maps=("DISPLACEMENT",), storage="MEMORY")
            found.add(bake_pair(bpy.context, low, [high], settings).image)
    assert len(found) == 2
    assert len(bpy.data.images) == 4
