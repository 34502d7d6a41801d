# SPDX-License-Identifier: GPL-3.0-or-later
"""A part that is deleted here gives its texels up in files as well. One that only another .blend can have keeps them."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.output import image_file, shared_maps
from tests.support import scenes, zoo
from tests.support.panel import refusal, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

PLACES = {"a": (0.03, 0.03), "b": (0.53, 0.03), "c": (0.03, 0.53)}
TEXELS = {"a": np.s_[3:11, 3:11], "b": np.s_[3:11, 20:28], "c": np.s_[20:28, 3:11]}
"""Some of each, from the bottom left, of 32 x 32."""


@pytest.fixture
def prop(tmp_path):
    """A set by names, whose three parts share one file, baked. Returns that file."""
    for number, (name, place) in enumerate(PLACES.items()):
        low, high = zoo.plane(f"{name}_low", 2), zoo.terrain(f"{name}_high", 8, height=0.2)
        low.location.x = high.location.x = 4.0 * number
        scenes.move_uvs(low, (0.4, 0.4), place)
    path = tmp_path / "prop.png"
    make_set(path)
    bake()
    return path


def make_set(path):
    use(size=32, method="CAST", samples="1", depth="8", storage="FILE", output=str(path))
    one = bpy.context.scene.imprint_sets.add()
    one.name, one.source, one.textures = "Prop", "NAMES", "ONE"
    bpy.context.scene.imprint.bakes = "SETS"


def bake(**values):
    bpy.context.view_layer.update()
    assert bpy.ops.imprint.bake_sets(**values) == {"FINISHED"}


def edit(name):
    for point in bpy.data.objects[f"{name}_high"].data.vertices:
        point.co.z *= -2.0
    bpy.data.objects[f"{name}_high"].data.update()


def delete(*names):
    bpy.data.batch_remove([bpy.data.objects[f"{name}_{end}"] for name in names for end in ("low", "high")])


def join(name, other):
    for end in ("low", "high"):
        both = [bpy.data.objects[f"{each}_{end}"] for each in (name, other)]
        with bpy.context.temp_override(active_object=both[0], object=both[0], selected_editable_objects=both):
            assert bpy.ops.object.join() == {"FINISHED"}


def save_and_open(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))


def parts_in(path: Path):
    return {part.name for part in shared_maps._from_text(image_file.note_of(path))}


@pytest.mark.parametrize("is_changed", [True, False])
@pytest.mark.parametrize("way", ["deleted", "deleted twice", "saved and opened", "joined"])
def test_a_deleted_part_gives_its_texels_up(prop, way, is_changed):
    before = image_file.read(prop)
    if way == "joined":
        join("b", "c")
    else:
        delete("c")
    if way == "deleted twice":
        edit("b")
        bake(changed=is_changed)
        before = image_file.read(prop)
        delete("b")
    if way == "saved and opened":
        save_and_open(prop.with_name("scene.blend"))
    edit("a")
    bake(changed=is_changed)
    after = image_file.read(prop)
    assert parts_in(prop) == ({"a_low"} if way == "deleted twice" else {"a_low", "b_low"})
    assert (after[TEXELS["a"]] != before[TEXELS["a"]]).any()
    if way != "deleted twice":
        np.testing.assert_allclose(after[TEXELS["b"]], before[TEXELS["b"]], atol=0.01)
    if way == "joined":
        np.testing.assert_allclose(after[TEXELS["c"]], before[TEXELS["c"]], atol=0.01)
    written = prop.stat().st_mtime_ns
    bpy.ops.imprint.bake_sets(changed=True)
    assert prop.stat().st_mtime_ns == written


def write_by_another(path):
    """As another .blend does that has its part in the same file."""
    content = path.read_bytes()
    edit("b")
    bake()
    path.write_bytes(content)
    delete("c")


def append(path):
    """One part, with the image of all, into a .blend of its own."""
    file = path.with_name("scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(file)) as (_, into):
        into.objects = ["a_low", "a_high"]
    for obj in into.objects:
        bpy.context.collection.objects.link(obj)
    make_set(path)
    assert bpy.data.images["Prop_normal"].get(shared_maps.RECORD)


def append_beside_own(path):
    """The .blend has baked other maps."""
    append(path)
    bpy.data.images["Prop_normal"].name = "kept"
    use(output=str(path.with_name("own.png")))
    low = zoo.plane("d_low", 2)
    low.location.x, zoo.terrain("d_high", 8).location.x = 40.0, 40.0
    scenes.move_uvs(low, (0.4, 0.4), PLACES["b"])
    bake()
    delete("d")
    bpy.data.images.remove(bpy.data.images["Prop_normal"])
    bpy.data.images["kept"].name = "Prop_normal"
    use(output=str(path))


def link_and_lose(path):
    """The library of a part cannot be read today."""
    one, library = bpy.context.scene.imprint_sets[0], path.with_name("library.blend")
    one.source = "PARTS"
    for name in "ab":
        one.parts.add().object = bpy.data.objects[f"{name}_low"]
    bpy.data.libraries.write(str(library), {bpy.data.objects["c_low"]}, fake_user=True)
    delete("c")
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.objects = ["c_low"]
    bpy.context.collection.objects.link(into.objects[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(path.with_name("scene.blend")))
    library.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(path.with_name("scene.blend")))


def bake_into_another_file(path):
    """The image was written elsewhere since, so that another .blend may have the part in the first file."""
    use(output=str(path.with_name("other.png")))
    bake()
    delete("c")
    use(output=str(path))


@pytest.mark.parametrize("change", [write_by_another, append, append_beside_own, link_and_lose, bake_into_another_file])
def test_a_part_that_another_file_can_have_is_refused(prop, change):
    change(prop)
    content = prop.read_bytes()
    edit("a")
    bpy.context.view_layer.update()
    said = refusal(bpy.ops.imprint.bake_sets)
    assert "which is not in this file, and would lose it" in said
    assert prop.read_bytes() == content
