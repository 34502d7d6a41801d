# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what bakes of several low objects do where some of them lack a vertex group."""

import bpy
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, bake_all
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SMALL = {"width": 16, "height": 16, "storage": "MEMORY", "method": "CAST"}


@pytest.fixture
def jobs():
    """Two pairs. Only the first low object has the group."""
    pairs = [(zoo.plane(f"{name}_low"), zoo.plane(f"{name}_high")) for name in "ab"]
    pairs[0][0].vertex_groups.new(name="far").add([0], 1.0, "REPLACE")
    return [Job(low, [high]) for low, high in pairs]


@pytest.mark.parametrize("share_image", [False, True])
def test_one_of_several_low_objects_may_lack_the_group(jobs, share_image):
    settings = Settings(offset_group="far", image="all" if share_image else "", **SMALL)
    painted, unpainted = bake_all(bpy.context, jobs, settings, share_image=share_image)
    assert painted.settings["offset_group"] == "far"
    assert unpainted.settings["offset_group"] == ""


@pytest.mark.parametrize("setting", ["offset_group", "straight_group"])
def test_a_group_that_no_low_object_has_is_a_mistake(jobs, setting):
    with pytest.raises(BakeError, match="No low object has a vertex group 'near'"):
        bake_all(bpy.context, jobs, Settings(**{setting: "near"}, **SMALL))
    assert not bpy.data.images


def test_one_of_several_low_objects_must_have_the_group(jobs):
    """Another object that has it is not enough."""
    jobs[0].low.vertex_groups.clear()
    jobs[0].highs[0].vertex_groups.new(name="far")
    with pytest.raises(BakeError, match="No low object has a vertex group 'far'"):
        bake_all(bpy.context, jobs, Settings(offset_group="far", **SMALL))


def test_a_single_low_object_may_lack_a_group_that_another_object_has(jobs):
    bake_all(bpy.context, jobs[1:], Settings(offset_group="far", **SMALL))
    with pytest.raises(BakeError, match="'b_low' has no vertex group 'near'"):
        bake_all(bpy.context, jobs[1:], Settings(offset_group="near", **SMALL))
    assert len(bpy.data.images) == 1


def test_flatten_ignores_the_groups(jobs):
    bake_all(bpy.context, jobs, Settings(**SMALL | {"method": "FLATTEN", "offset_group": "near"}))


def test_the_low_object_may_be_its_own_cage(jobs):
    """Reading the cage frees the evaluated mesh that the weights are of."""
    job = Job(jobs[0].low, jobs[0].highs, jobs[0].low)
    (report,) = bake_all(bpy.context, [job], Settings(offset_group="far", **SMALL))
    assert report.missed == 0.0
