# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps survive: a file with maps of each kind of output is saved, opened in another process, and compared."""

import bpy
import pytest

from tests.support import saved_scenes
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
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    saved_scenes.save(path["first"])  # files are relative to it
    for kind in KINDS:
        saved_scenes.build(kind, str(folder))
        saved_scenes.bake(kind)
    saved_scenes.show_bake()
    saved = {"never": saved_scenes.state(), "first": saved_scenes.save(path["first"])}
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


@pytest.mark.parametrize("way", WAYS[:5])
@pytest.mark.parametrize("kind", KINDS)
def test_images_of_a_saved_file_are_those_that_were_saved(states, kind, way):
    saved, found = (of(kind, each[way]) for each in states)
    assert saved
    assert found == saved
    assert all(image["content"] for image in found.values())


@pytest.mark.parametrize("kind", KINDS)
def test_saving_changes_no_image(states, kind):
    """But for those in memory, which it packs."""
    before, after = of(kind, states[0]["never"]), of(kind, states[0]["first"])
    for image in (*before.values(), *after.values()):
        if "memory" in kind or kind == "live is on":
            for name in FOR_MEMORY:
                del image[name]
    assert before == after


@pytest.mark.parametrize("part", ["settings", "materials", "views", "hidden"])
@pytest.mark.parametrize("way", WAYS[:5])
def test_the_rest_of_a_saved_file_is_as_it_was(states, way, part):
    saved, found = (each[way][part] for each in states)
    assert saved
    assert found == saved


@pytest.mark.parametrize(("way", "other"), [("elsewhere", "first"), ("twice", "first"), ("again", "second")])
@pytest.mark.parametrize("kind", KINDS)
def test_the_way_of_a_file_does_not_change_pixels(states, kind, way, other):
    """A second bake into images of an opened file is that into the images of the first bake."""
    one, two = (of(kind, states[1][each]) for each in (way, other))
    assert {name: image["content"] for name, image in one.items()} == {
        name: image["content"] for name, image in two.items()
    }


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


@pytest.mark.parametrize("way", ["appended", "linked"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_low_object_in_another_file_brings_its_maps(states, kind, way):
    first = of(kind, states[1]["first"])
    for found in (each[way] for each in states):
        there = of(kind, found)
        assert there.keys() == first.keys()
        for name, image in first.items():
            assert {key: there[name][key] for key in COPIED} == {key: image[key] for key in COPIED}
