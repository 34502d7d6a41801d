# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps survive: a file with maps of each kind of output is saved, opened in another process, and compared."""

import bpy
import pytest

from addon.jobs import map_contents
from addon.ui import held_maps
from addon.ui.held_maps import held
from tests.support import saved_scenes, zoo
from tests.support.maps import pixels
from tests.support.saved_scenes import KINDS

WAYS = ["first", "elsewhere", "twice", "second", "again", "appended", "linked"]
"""first: baked and saved. elsewhere: then saved as another file in another folder. second: then all baked a second time.
twice: the first file, opened on another day and saved elsewhere. again: then all baked a second time. appended, linked: the low
objects of the first file in another file."""
FOR_MEMORY = {"source", "packed", "is_dirty", "own"}
"""What saving changes of an image in memory: it packs it."""


@pytest.fixture(scope="module")
def states(tmp_path_factory, gpu_context, registered):
    """The state of the file of each way when it was saved, the one in another process, and that before all."""
    folder = tmp_path_factory.mktemp("saved")
    path = {way: folder / way / "scene.blend" for way in WAYS}
    saved = saved_scenes.first_day(str(folder), str(path["first"]))
    saved["elsewhere"] = saved_scenes.save(path["elsewhere"])
    for kind in KINDS:
        saved_scenes.bake(kind)
    saved["second"] = saved_scenes.save(path["second"])
    later = ("first", "twice", "again", "appended", "linked")
    next_day = saved_scenes.run(saved_scenes.next_day, folder, *map(path.get, later))
    found = {"first": next_day.pop("first")}
    rest = [way for way in WAYS if way != "first"]
    found |= dict(zip(rest, saved_scenes.run(saved_scenes.all_opened, folder, *map(path.get, rest)), strict=True))
    return saved | next_day, found


def of(kind, state):
    """The images of a kind."""
    return {name: state["images"][name] for name in saved_scenes.images_of(kind, state["images"])}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS[:5])
@pytest.mark.parametrize("kind", KINDS)
def test_images_of_a_saved_file_are_those_that_were_saved(states, kind, way):
    saved, found = (of(kind, each[way]) for each in states)
    assert saved
    assert found == saved
    assert all(image["content"] for image in found.values())


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_saving_changes_no_image(states, kind):
    """But for those in memory, which it packs."""
    before, after = of(kind, states[0]["never"]), of(kind, states[0]["first"])
    for image in (*before.values(), *after.values()):
        if "memory" in kind or kind == "live is on":
            for name in FOR_MEMORY:
                del image[name]
    assert before == after


@pytest.mark.slow
@pytest.mark.parametrize("part", ["pairs", "settings", "materials", "views", "hidden"])
@pytest.mark.parametrize("way", WAYS[:5])
def test_the_rest_of_a_saved_file_is_as_it_was(states, way, part):
    saved, found = (each[way][part] for each in states)
    assert saved
    assert found == saved


@pytest.mark.slow
@pytest.mark.parametrize(("way", "other"), [("elsewhere", "first"), ("twice", "first"), ("again", "second")])
@pytest.mark.parametrize("kind", KINDS)
def test_the_way_of_a_file_does_not_change_pixels(states, kind, way, other):
    """A second bake into images of an opened file is that into the images of the first bake."""
    one, two = (of(kind, states[1][each]) for each in (way, other))
    assert {name: image["content"] for name, image in one.items()} == {
        name: image["content"] for name, image in two.items()
    }


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_second_bake_draws_other_pixels_and_adds_no_user(states, kind):
    first, second = (of(kind, states[1][way]) for way in ("first", "second"))
    assert first.keys() == second.keys()
    for name, image in first.items():
        assert [image[key] for key in ("users", "fake_user", "used_by")] == [
            second[name][key] for key in ("users", "fake_user", "used_by")
        ]
    # Base colors do not depend on the height of the high mesh.
    changed = {name for name, image in first.items() if image["content"] != second[name]["content"]}
    assert changed or kind == "levels"


COPIED = {"content", "size", "source", "is_float", "colorspace", "alpha_mode", "half", "tiles", "packed", "file", "own"}
"""What a copy of an image in another file has in common with it."""


@pytest.mark.slow
@pytest.mark.parametrize("way", ["appended", "linked"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_low_object_in_another_file_brings_its_maps(states, kind, way):
    first = of(kind, states[1]["first"])
    for found in (each[way] for each in states):
        there = of(kind, found)
        assert there.keys() == first.keys()
        for name, image in first.items():
            assert {key: there[name][key] for key in COPIED} == {key: image[key] for key in COPIED}
        names = saved_scenes.lows(kind)
        assert [found["pairs"][name] for name in names] == [states[1]["first"]["pairs"][name] for name in names]


@pytest.mark.parametrize("storage", ["PACK", "MEMORY"])
@pytest.mark.parametrize("depth", ["8", "16"])
def test_undo_and_redo_bring_back_the_pixels_of_their_step(gpu_context, registered, storage, depth):
    """Of the first bake, whose images Undo removes, and of a second one of another size."""
    zoo.terrains_in_slots("FLATTEN")
    settings = bpy.context.scene.imprint
    settings.storage, settings.depth, settings.maps = storage, depth, {"AO"}
    bpy.ops.ed.undo_push(message="before")

    def images():
        return {image.name: pixels(image).tobytes() for image in bpy.data.images}

    steps = [images()]
    for size in (16, 24):
        settings.size = size
        bpy.data.objects["hi"].scale.z *= 1.5
        bpy.context.view_layer.update()
        bpy.ops.ed.undo_push(message="other")
        steps.append(images())
        assert bpy.ops.imprint.bake("EXEC_DEFAULT", True) == {"FINISHED"}
        settings = bpy.context.scene.imprint
        steps.append(images())
    assert [len(step) for step in steps] == [0, 0, 2, 2, 2]
    assert steps[2] != steps[4]
    for go, numbers in (
        (bpy.ops.ed.undo, (3, 2, 1, 0)),
        (bpy.ops.ed.redo, (1, 2, 3, 4)),
        (bpy.ops.ed.undo, (3, 2, 1, 0)),
    ):
        for number in numbers:
            assert go() == {"FINISHED"}
            assert images() == steps[number], (go, number)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not held.number


def test_maps_in_memory_are_held_up_to_a_size(gpu_context, registered, monkeypatch):
    """The last ones come back, and the memory has a limit."""
    zoo.terrains_in_slots("FLATTEN")
    settings = bpy.context.scene.imprint
    settings.storage, settings.size = "MEMORY", 16
    monkeypatch.setattr(held_maps, "MOST_HELD", 2 * 16 * 16 * 16)
    for number in (1, 2, 3, 4):
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        assert held.number == min(number, 2)


STORES = {
    "packed 8": {"storage": "PACK", "depth": "8"},
    "packed 32": {"storage": "PACK", "depth": "32"},
    "memory": {"storage": "MEMORY"},
    "png": {"storage": "FILE", "output": "//a.png"},
    "opaque": {"storage": "FILE", "output": "//b.tif", "depth": "8", "alpha": False},
    "exr": {"storage": "FILE", "output": "//c.exr", "depth": "32"},
    "tiles": {"udim": True},
    "tiles in files": {"udim": True, "storage": "FILE", "output": "//d.png"},
}


@pytest.mark.slow
@pytest.mark.parametrize("after", STORES)
@pytest.mark.parametrize("before", STORES)
def test_a_map_that_is_stored_in_another_way_is_saved_as_such(gpu_context, registered, tmp_path, before, after):
    """The image of the first bake gets the second one, and keeps nothing of where the first one was."""
    zoo.terrains_in_slots("FLATTEN")
    settings = bpy.context.scene.imprint
    settings.size, settings.maps = 16, {"AO"}
    path = tmp_path / "scene.blend"
    saved_scenes.save(path)
    alone = []
    for way in (after, before, after):
        for name, value in ({"udim": False, "alpha": True, "depth": "16", "storage": "PACK"} | STORES[way]).items():
            setattr(settings, name, value)
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        alone.append(saved_scenes.save(path)["images"])
    bpy.ops.wm.open_mainfile(filepath=str(path))
    found = saved_scenes.state()["images"]
    assert found == alone[2]
    for name, image in alone[0].items():
        for each in (found[name], image):
            each["own"].pop(map_contents.MAP)  # each bake has another key
        assert {key: found[name][key] for key in COPIED} == {key: image[key] for key in COPIED}


def test_an_override_of_a_low_object_keeps_its_maps(gpu_context, registered, tmp_path):
    """Those of the library, and those that are baked for the override."""
    low, _ = zoo.terrains_in_slots("FLATTEN")
    bpy.context.scene.imprint.maps = {"AO"}
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    library, path = tmp_path / "library.blend", tmp_path / "scene.blend"
    saved_scenes.save(library)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert bpy.ops.wm.link(directory=f"{library}/Object/", files=[{"name": "lo"}]) == {"FINISHED"}
    low = bpy.data.objects["lo"].override_hierarchy_create(bpy.context.scene, bpy.context.view_layer)
    low = low if low.name == "lo" and low.override_library else bpy.data.objects["lo", None]
    settings = bpy.context.scene.imprint
    settings.low, settings.method, settings.size, settings.image, settings.maps = low, "FLATTEN", 16, "own", {"HEIGHT"}
    settings.material = False
    settings.highs.add().object = zoo.terrain("high", n=8, height=0.3)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    saved_scenes.save(path)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    maps = bpy.data.objects["lo", None].imprint.maps
    assert sorted(item.image.name for item in maps) == ["lo_ao", "lo_normal", "own", "own_height"]
