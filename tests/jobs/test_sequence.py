# SPDX-License-Identifier: GPL-3.0-or-later
"""A map for each frame of an animation."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.jobs import Job, bake_pair
from addon.jobs.sequence import FRAME_IMAGE, work_on_frames
from addon.output import datablocks, map_names
from tests.support import zoo
from tests.support.maps import pixels
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.fixture
def job():
    """A plane, and a plane that a shape key tilts from frame 1 to frame 11."""
    low, high = zoo.plane("lo"), zoo.plane("hi", n=4)
    high.shape_key_add(name="Basis")
    key = high.shape_key_add(name="Tilted")
    points = np.empty(len(high.data.vertices) * 3, np.float32)
    key.data.foreach_get("co", points)
    points[2::3] = points[0::3]
    key.data.foreach_set("co", points)
    for frame, value in ((1, 0.0), (11, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)
    for curve in high.data.shape_keys.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    return Job(low, [high])


def settings(tmp_path, name="map.exr", **values):
    return Settings(
        method="FLATTEN",
        space="OBJECT",
        width=16,
        height=16,
        storage="FILE",
        depth=32,
        output=str(tmp_path / name),
        **values,
    )


def test_each_frame_has_the_map_of_its_surface(job, tmp_path):
    bpy.context.scene.frame_set(3)
    frames = range(1, 12, 5)
    reports = finish(work_on_frames(bpy.context, job, settings(tmp_path), frames, Pace()))
    assert [report.output for report in reports] == [[str(tmp_path / f"map_{frame:04}.exr")] for frame in frames]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map_0001.exr", "map_0006.exr", "map_0011.exr"]
    for frame, report in zip(frames, reports, strict=True):
        slope = (frame - 1) / 10
        normal = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
        image = bpy.data.images.load(*report.output)
        assert np.abs(pixels(image)[8, 8, :3] - (normal * 0.5 + 0.5)).max() < 1e-6
    assert bpy.context.scene.frame_current == 3
    image = bpy.data.images["lo_normal"]
    assert image.source == "SEQUENCE"
    nodes = job.low.data.materials[0].node_tree.nodes
    (texture,) = [node for node in nodes if node.bl_idname == "ShaderNodeTexImage"]
    assert texture.image == image
    assert (texture.image_user.frame_start, texture.image_user.frame_duration) == (1, 3)
    assert FRAME_IMAGE not in bpy.data.images
    finish(work_on_frames(bpy.context, job, settings(tmp_path), frames, Pace()))  # again, over the same files


def test_each_frame_shows_its_own_map(job, tmp_path):
    finish(work_on_frames(bpy.context, job, settings(tmp_path), range(5, 9), Pace()))
    for frame, shown in ((5, 5), (7, 7), (8, 8), (20, 8)):
        bpy.context.scene.frame_set(frame)
        shown_object = job.low.evaluated_get(bpy.context.evaluated_depsgraph_get())
        nodes = shown_object.material_slots[0].material.node_tree.nodes
        (texture,) = [node for node in nodes if node.bl_idname == "ShaderNodeTexImage"]
        path = texture.image.filepath_from_user(image_user=texture.image_user)
        assert path == str(tmp_path / f"map_{shown:04}.exr")


@pytest.mark.parametrize(
    ("name", "expected"),
    [("map.png", "map_0007.png"), ("m_##_a.exr", "m_07_a.exr"), ("a#_###.png", "a#_007.png"), ("#.png", "7.png")],
)
def test_the_frame_number_is_in_the_file_name(name, expected):
    assert map_names.output_of_frame(name, 7) == expected


def test_finished_frames_stay_when_a_sequence_is_stopped(job, tmp_path):
    bpy.context.scene.frame_set(3)
    work = work_on_frames(bpy.context, job, settings(tmp_path), range(1, 49), Pace())
    steps = []
    while not (steps and steps[-1].finished == 2):
        steps.append(next(work))
    work.close()
    assert [step.report.image for step in steps if step.report] == ["lo_normal"] * 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map_0001.exr", "map_0002.exr"]
    assert bpy.context.scene.frame_current == 3
    assert bpy.data.images["lo_normal"].source == "SEQUENCE"
    nodes = job.low.data.materials[0].node_tree.nodes
    assert [node.image_user.frame_duration for node in nodes if node.bl_idname == "ShaderNodeTexImage"] == [2]
    assert FRAME_IMAGE not in bpy.data.images


def test_a_sequence_stopped_at_its_first_frame_leaves_nothing(job, tmp_path):
    before = snapshot()
    work = work_on_frames(bpy.context, job, settings(tmp_path), range(1, 49), Pace())
    next(work)
    work.close()
    assert difference(before, snapshot()) == {}
    assert list(tmp_path.iterdir()) == []


def test_other_maps_of_a_sequence_leave_no_image(job, tmp_path):
    bpy.context.scene.frame_set(3, subframe=0.5)
    work = work_on_frames(bpy.context, job, settings(tmp_path, maps=("HEIGHT",), mask=True), range(1, 3), Pace())
    finish(work)
    assert [image.name for image in bpy.data.images] == ["lo_normal"]
    assert len(list(tmp_path.iterdir())) == 6
    assert bpy.context.scene.frame_current_final == 3.5
    bake_pair(bpy.context, job.low, job.highs, settings(tmp_path))  # a single map replaces the sequence
    assert bpy.data.images["lo_normal"].source == "FILE"


@pytest.mark.parametrize(
    ("wrong", "frames"),
    [
        ({"storage": "PACK"}, range(3)),
        ({}, range(0)),
        ({"udim": True}, range(3)),
        ({}, range(-2, 3)),
        ({"name": "a_##_v2.exr"}, range(3)),
        ({"name": "a_#", "format": "AUTO", "depth": 16}, range(1, 3)),
    ],
)
def test_settings_that_cannot_be_a_sequence(job, tmp_path, wrong, frames):
    before = snapshot()
    values = {"name": "map.exr"} | wrong
    asked = replace(settings(tmp_path, values.pop("name")), **values)
    with pytest.raises(BakeError):
        finish(work_on_frames(bpy.context, job, asked, frames, Pace()))
    assert difference(before, snapshot()) == {}
    assert list(tmp_path.iterdir()) == []


def test_a_sequence_takes_no_texture_sets(job, tmp_path):
    chosen = settings(tmp_path, "{material}_#.exr", texture_sets=True)
    with pytest.raises(BakeError, match="turn Texture Sets off"):
        finish(work_on_frames(bpy.context, job, chosen, range(1, 3), Pace()))
    assert not any(tmp_path.iterdir())


def test_a_low_object_that_cannot_have_a_material_raises_an_error_before_any_frame(job, tmp_path):
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    with bpy.data.libraries.load(path, link=True) as (_, linked_data):
        linked_data.objects = ["lo"]
    bpy.context.scene.collection.objects.link(linked_data.objects[0])
    linked = Job(linked_data.objects[0], job.highs)
    with pytest.raises(BakeError, match="is linked from a library"):
        finish(work_on_frames(bpy.context, linked, settings(tmp_path), range(1, 3), Pace()))
    assert [path.name for path in tmp_path.iterdir()] == ["library.blend"]


@pytest.mark.parametrize("source", ["the open file", "a linked library"])
def test_a_frame_that_would_overwrite_a_file_of_the_scene_raises_an_error_before_any_frame(
    job, tmp_path, monkeypatch, source
):
    taken = tmp_path / "map_0002.exr"
    taken.write_text("a scene")
    monkeypatch.setattr(datablocks, "sources", lambda: iter([(str(taken), source)]))
    with pytest.raises(BakeError, match=f"would overwrite {source}"):
        finish(work_on_frames(bpy.context, job, settings(tmp_path), range(1, 3), Pace()))
    assert [path.name for path in tmp_path.iterdir()] == ["map_0002.exr"]


def test_a_sequence_that_replaces_the_map_of_another_high_object_raises_a_warning(job, tmp_path):
    other = zoo.plane("other", slope=0.5)
    still = settings(tmp_path, "still.exr", image="m")
    bake_pair(bpy.context, job.low, [other], still)
    settings_of_sequence = replace(still, output=str(tmp_path / "map.exr"))
    for expected in (["The map of 'hi' replaced a map of 'other' in the image 'm'."], []):
        reports = finish(work_on_frames(bpy.context, job, settings_of_sequence, range(1, 3), Pace()))
        warnings = [text for report in reports for text in report.warnings if "replaced" in text]
        assert warnings == expected
        assert datablocks.origin("m") == ["hi"]
