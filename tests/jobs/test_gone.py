# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that are deleted or renamed between two slices of a bake, and objects that share a name."""

import itertools

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_jobs, bake_pair, live_session, masks
from addon.jobs.sequence import work_on_frames
from addon.output import datablocks
from addon.ui.live import live
from tests.support import scenes, zoo
from tests.support.maps import pixels
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

SLICED = 1e-9
"""Seconds of a slice. So short that each step is a slice."""
STEEP = 1.0
"""Slope of a surface whose normals differ clearly from those of a flat one."""


def settings(**values):
    return Settings(**{"method": "CAST", "space": "OBJECT", "width": 16, "height": 16, "storage": "MEMORY"} | values)


def pairs(names="ab"):
    lows = [zoo.plane(name) for name in names]
    return [Job(low, [zoo.plane(f"{low.name} high", 4)]) for low in lows]


def remove(name):
    bpy.data.objects.remove(bpy.data.objects[name])


def steps_of(work):
    """The steps of `work`, and at the end the message of its error; empty if it has none."""
    try:
        yield from work
    except BakeError as error:
        yield str(error)
    else:
        yield ""


def stopped_by(work, change, step):
    """The message of the error if `change` runs after this many steps; None if `work` is already done."""
    steps = list(itertools.islice(work, step))
    if len(steps) < step:
        return None
    change()
    return list(steps_of(work))[-1]


def endings(make, change):
    """The messages of errors if `change` runs after the first step, the second, ... each in a new file."""
    for step in itertools.count(1):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        message = stopped_by(make(), change, step)
        if message is None:
            return
        yield message


@pytest.mark.parametrize(("name", "share_image"), [("a high", False), ("b", False), ("a", True), ("b high", True)])
def test_a_deleted_object_raises_an_error_at_every_step(name, share_image):
    def make():
        return bake_jobs.work(bpy.context, pairs(), settings(), Pace(SLICED), share_image=share_image)

    messages = list(endings(make, lambda: remove(name)))
    assert len(messages) > 6
    assert set(messages) <= {"", f"{name!r} was deleted: bring it back with Undo, or choose another object."}
    assert any(messages)


@pytest.mark.parametrize("name", ["a", "a high"])
def test_deleting_an_object_of_the_only_job_changes_nothing(name):
    work = bake_jobs.work(bpy.context, pairs("a"), settings(), Pace(SLICED))
    next(work)
    remove(name)
    before = snapshot()
    with pytest.raises(BakeError, match=f"'{name}' was deleted"):
        finish(work)
    assert difference(before, snapshot()) == {}


@pytest.mark.parametrize("share_image", [False, True], ids=["several", "atlas"])
@pytest.mark.parametrize("is_kept", [False, True], ids=["removed", "in a slot"])
def test_a_bake_ends_at_the_step_after_its_low_object_was_deleted(registered, share_image, is_kept):
    """As in a second window while the first one bakes: with X, which leaves an object that a slot of the panel points to."""
    jobs = pairs()
    deleted = "b" if share_image else "a"
    if is_kept:
        bpy.context.scene.imprint.low = bpy.data.objects[deleted]
    work = bake_jobs.work(bpy.context, jobs, settings(), Pace(SLICED), share_image=share_image)
    while next(work).what != "Drawing":
        pass
    with bpy.context.temp_override(selected_objects=[bpy.data.objects[deleted]]):
        bpy.ops.object.delete()
    assert (deleted in bpy.data.objects) == is_kept
    with pytest.raises(BakeError, match=f"'{deleted}' was deleted"):
        next(work)
    assert not bpy.data.images


def test_maps_of_finished_jobs_stay():
    work = bake_jobs.work(bpy.context, pairs(), settings(), Pace(SLICED))
    while next(work).finished < 1:
        pass
    remove("b")
    with pytest.raises(BakeError, match="'b' was deleted"):
        finish(work)
    assert [image.name for image in bpy.data.images] == ["a_normal"]


def test_the_others_are_baked_where_a_failure_is_no_end():
    steps, work = [], bake_jobs.work(bpy.context, pairs("abc"), settings(), Pace(SLICED), goes_on=True)
    while not (steps and steps[-1].finished):
        steps.append(next(work))
    remove("b")
    result = finish(work, steps.append)
    assert [report.low for report in result] == [step.report.low for step in steps if step.report] == ["a", "c"]
    ((name, why),) = [step.failure for step in steps if step.failure]
    assert name == "b" and "was deleted" in why


def test_an_atlas_is_not_replaced():
    gray = np.full((16, 16, 4), 0.5, np.float32)
    datablocks.fill("atlas", gray, is_float=True, pack=False)
    work = bake_jobs.work(bpy.context, pairs(), settings(image="atlas"), Pace(SLICED), share_image=True)
    while next(work).what != "Storing":
        pass
    remove("b")
    with pytest.raises(BakeError, match="'b' was deleted"):
        finish(work)
    assert np.array_equal(pixels(bpy.data.images["atlas"]), gray)
    assert not bpy.data.objects["a"].data.materials


def of_frames(tmp_path):
    files = settings(storage="FILE", depth=32, output=str(tmp_path / "map.exr"))
    return work_on_frames(bpy.context, pairs("a")[0], files, range(3, 6), Pace(SLICED))


@pytest.mark.parametrize("name", ["a", "a high"])
def test_finished_frames_stay(tmp_path, name):
    work = of_frames(tmp_path)
    while next(work).finished < 1:
        pass
    remove(name)
    with pytest.raises(BakeError, match=f"'{name}' was deleted"):
        finish(work)
    assert [path.name for path in tmp_path.iterdir()] == ["map_0003.exr"]
    assert bpy.data.images["a_normal"].source == "SEQUENCE"
    assert bpy.context.scene.frame_current == 1


def test_deleting_the_scene_ends_the_sequence(tmp_path):
    scene = bpy.context.scene
    work = of_frames(tmp_path)
    while next(work).finished < 1:
        pass
    bpy.data.scenes.new("Other")
    bpy.data.scenes.remove(scene)
    with pytest.raises(BakeError):
        finish(work)
    assert bpy.data.images["a_normal"].source == "SEQUENCE"


@pytest.mark.parametrize("share_image", [False, True], ids=["several", "atlas"])
def test_renaming_objects_does_not_change_a_bake(share_image):
    jobs = pairs()
    work = bake_jobs.work(bpy.context, jobs, settings(image="{low}"), Pace(SLICED), share_image=share_image)
    next(work)
    for obj in list(bpy.data.objects):
        obj.name = f"{obj.name} renamed"
    zoo.plane("a high", slope=STEEP)  # a new object with the old name
    finish(work)
    images = {"atlas"} if share_image else {"a", "b"}
    assert {image.name for image in bpy.data.images} == images
    assert all(bpy.data.objects[f"{name} renamed"].data.materials for name in "ab")
    texels = pixels(next(iter(bpy.data.images)))
    assert np.abs(texels[8, 8, :3] - (0.5, 0.5, 1.0)).max() < 1e-3


@pytest.fixture
def namesakes(tmp_path):
    """A low plane, and two objects called "hi": a flat one, and a linked steep one."""
    zoo.plane("hi", slope=STEEP)
    path = str(tmp_path / "library.blend")
    scenes.save(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    low, flat = zoo.plane("lo"), zoo.plane("hi")
    with bpy.data.libraries.load(path, link=True) as (_, linked_data):
        linked_data.objects = ["hi"]
    (steep,) = linked_data.objects
    bpy.context.scene.collection.objects.link(steep)
    assert flat.name == steep.name
    return low, flat, steep


@pytest.mark.parametrize("which", [1, 2], ids=["flat", "steep"])
def test_live_distinguishes_objects_with_the_same_name(namesakes, which):
    job = Job(namesakes[0], [namesakes[which]])
    bake_all(bpy.context, [job], settings(depth=32, image="baked"))
    following = live_session.Session(bpy.context, job, settings(), Pace())
    following.run(bpy.context)
    assert np.array_equal(following.texels, pixels(bpy.data.images["baked"]))
    following.free()


@pytest.mark.parametrize("which", [1, 2], ids=["flat", "steep"])
def test_checks_distinguish_objects_with_the_same_name(namesakes, which):
    low, *highs = namesakes
    highs[which - 1].location.x = 0.9  # no longer above all of the low plane
    bpy.context.view_layer.update()
    job = Job(low, [highs[which - 1]])
    near = settings(extrusion=2.0, max_distance=4.0)
    report = bake_all(bpy.context, [job], near)[0]
    low.name = "renamed"
    mask = pixels(masks.draw_mask(bpy.context, report, "uncovered"))[..., 0] > 0.5
    assert mask.mean() == pytest.approx(report.checks["uncovered"]["share"])
    assert mask.any()


@pytest.fixture
def library(tmp_path):
    """A library with the high object, a low object, and the linked high object."""
    path = tmp_path / "library.blend"
    zoo.terrain("hi", n=8)
    scenes.save(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, linked_data):
        linked_data.objects = ["hi"]
    bpy.context.scene.collection.objects.link(linked_data.objects[0])
    return bpy.data.libraries[0], zoo.plane("lo"), linked_data.objects[0]


@pytest.mark.usefixtures("registered")
def test_live_follows_objects_of_a_reloaded_library(library):
    source, low, high = library
    panel = bpy.context.scene.imprint
    panel.width = panel.height = 64
    live.start(bpy.context, Job(low, [high]), panel.to_settings())
    try:
        before = high.session_uid
        source.reload()
        assert bpy.data.objects["hi"].session_uid != before
        plan = live.session.plan
        for _ in range(20):
            live.tick()
        assert live.message == ""
        assert live.session.plan is not plan
        assert bpy.data.objects["hi"].session_uid in live.session.uids
    finally:
        live.stop()


@pytest.mark.parametrize("relative", [False, True])
def test_checks_find_objects_of_a_reloaded_library(library, tmp_path, relative):
    source, low, high = library
    report = bake_pair(bpy.context, low, [high], settings())
    if relative:  # Blender makes paths relative when it saves the scene
        (tmp_path / "scenes").mkdir()
        scenes.save(tmp_path / "scenes" / "scene.blend")
        source.filepath = "//../library.blend"
    source.reload()
    assert masks.find(bpy.context, report, "polygons").tolist() == [0]
    bpy.data.objects.remove(bpy.data.objects["hi"])
    zoo.terrain("hi", n=8)
    with pytest.raises(BakeError, match="'hi' was deleted"):
        masks.find(bpy.context, report, "polygons")


@pytest.mark.parametrize("linked", ["objects", "meshes"])
@pytest.mark.parametrize("is_low", [True, False])
def test_an_object_with_a_missing_library_raises_an_error(tmp_path, linked, is_low):
    """Blender replaces it by an empty, or by a mesh without faces."""
    library, scene = tmp_path / "library.blend", tmp_path / "scene.blend"
    zoo.terrain("linked", n=8)
    scenes.save(library)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(library), link=True) as (there, linked_data):
        setattr(linked_data, linked, getattr(there, linked)[:1])
    found = getattr(linked_data, linked)[0]
    obj = found if linked == "objects" else bpy.data.objects.new("linked", found)
    bpy.context.scene.collection.objects.link(obj)
    zoo.plane("other")
    scenes.save(scene)
    library.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(scene))
    names = ("linked", "other") if is_low else ("other", "linked")
    low, high = (bpy.data.objects[name] for name in names)
    with pytest.raises(BakeError, match=r"^'linked' is linked from '.*library\.blend', but is not in that file: "):
        bake_pair(bpy.context, low, [high], settings())
