# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of a part tells whether a bake would make other maps. The truth are the maps of a fresh bake."""

import bpy
import pytest

from addon.core.progress import finish
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs, part_state
from addon.jobs.part_state import State, Status
from addon.ui import object_pairs
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SAME = {"method": "CAST", "width": 16, "height": 16, "margin": 2, "material": False}


def pair():
    low, high = zoo.plane("brick_low", 2), zoo.terrain("brick_high", 12, height=0.2)
    bpy.context.view_layer.update()
    return Job(low, [high])


def bake(job, settings):
    """Bake, and keep what was read with the low object."""
    object_pairs.remember(bake_jobs.bake_all(bpy.context, [job], settings))


def found(job, settings):
    """What differs since the bake."""
    then = part_state.kept(job.low)
    return part_state.changes(then, finish(part_state.look(bpy.context, job, settings, then=then)))


def test_says_what_changed_in_words():
    job, settings = pair(), Settings(**SAME)
    assert part_state.kept(job.low) is None and part_state.status(None, None) is Status.NEVER
    bake(job, settings)
    assert found(job, settings) == []
    point = job.highs[0].data.vertices[40]
    before = tuple(point.co)
    point.co.z += 0.1
    assert found(job, settings) == ["the mesh of 'brick_high'"]
    point.co = before
    assert found(job, settings.sampled(samples=4)) == ["the setting Samples"]
    bpy.data.images.remove(bpy.data.images["brick_low_normal"])
    assert found(job, settings) == ["the image 'brick_low_normal' is gone"]


def test_renamed_is_not_changed():
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    job.low.name, job.highs[0].name = "stone_low", "stone_high"
    bpy.data.images["brick_low_normal"].name = "stone"
    assert found(job, settings) == []
    other = State({"mesh:a": "1", "mesh:b": "2"})
    assert part_state.changes(other, State({"mesh:b": "1", "mesh:a": "2"})) == []
    assert part_state.changes(other, State({"mesh:a": "1", "mesh:c": "3"})) == ["the mesh of 'c'", "the mesh of 'b'"]
