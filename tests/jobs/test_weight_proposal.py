# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that weights are proposed where they help, and nowhere else."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.engine import unsure_texels
from addon.jobs import Job, bake_all, bake_pair, weights
from addon.jobs.masks import draw_mask
from addon.mesh.inputs import Meshes
from addon.mesh.triangle_mesh import Mesh
from addon.scene import mesh_elements
from tests.support import layered_scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


NONE = {"offset_group": "", "straight_group": ""}
STEP = {"extrusion": 0.3, "max_distance": 0.6}
"""Rays that reach the lower half of `step_up`, and with twice the extrusion the upper one as well."""


def bake(low, *highs, **settings):
    values = {"method": "CAST", "width": 64, "height": 64, "storage": "MEMORY", "material": False}
    return bake_pair(bpy.context, low, highs, Settings(**values | settings))


def step_up():
    """Two halves of a high plane: x < 0 is 0.1 above the low one, the other half 0.5."""
    left, right = zoo.plane("left"), zoo.plane("right")
    for high, side, height in ((left, -1.0, 0.1), (right, 1.0, 0.5)):
        high.scale.x, high.location.x, high.location.z = 0.5, 0.5 * side, height
    return left, right


def x_of(low):
    return np.array([vertex.co.x for vertex in low.data.vertices])


@pytest.mark.parametrize("udim", [False, True])
def test_more_offset_where_rays_missed(udim):
    low, highs = zoo.plane("lo", n=8), step_up()
    report = bake(low, *highs, **STEP, udim=udim, storage="PACK")
    assert 0.45 < report.missed < 0.55
    proposal = weights.propose(bpy.context, report, NONE)
    offset, straight = (proposal.weights[setting] for setting in NONE)
    assert (offset[x_of(low) > 0.1] == 1.0).all()
    assert (offset[x_of(low) < -0.1] == 0.5).all()
    assert (straight == 0.5).all()
    assert np.isclose(proposal.before, report.missed, atol=0.01)
    assert proposal.after == 0.0
    groups = weights.apply(low, proposal, NONE)
    assert groups == weights.GROUP_NAMES
    assert bake(low, *highs, **STEP, **groups).missed == 0.0


def test_smooth_directions_where_straight_rays_pass_the_high_mesh():
    low = zoo.cube("lo")
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=1.2)
    high = bpy.context.object
    rays = {"directions": "SPLIT", "extrusion": 0.3, "max_distance": 1.0}
    report = bake(low, high, **rays)
    assert report.missed > 0.05
    proposal = weights.propose(bpy.context, report, NONE)
    assert (proposal.weights["straight_group"] == 0.0).all()
    assert (proposal.weights["offset_group"] == 0.5).all()
    assert proposal.after < proposal.before
    assert bake(low, high, **rays, **weights.apply(low, proposal, NONE)).missed < 0.1 * report.missed


def test_less_offset_where_rays_start_behind_another_layer():
    """Two sheets, one above the other, have half of the map each. With the first hit, the lower one shows the upper one."""
    points = [(x, y, z) for z in (0.0, 0.5) for y in (-1, 1) for x in (-1, 1)]
    uv = np.array([[(u, 0), (u + 0.5, 0), (u + 0.5, 1), (u, 1)] for u in (0.0, 0.5)])
    low, high = (zoo.build(name, points, [(0, 1, 3, 2), (4, 5, 7, 6)], uv) for name in ("lo", "hi"))
    high.location.z = 0.01
    rays = {"hit": "OUTERMOST", "extrusion": 0.8, "max_distance": 1.0}
    report = bake(low, high, **rays)
    assert report.checks["unsure"]["other_layer"] > 0
    proposal = weights.propose(bpy.context, report, NONE)
    assert proposal.weights["offset_group"].tolist() == [0.25] * 4 + [0.5] * 4
    assert proposal.before == 0.5
    assert proposal.after == 0.0
    assert bake(low, high, **rays, **weights.apply(low, proposal, NONE)).checks["unsure"]["count"] == 0


def test_parts_that_stand_off_stay():
    low, base, plate = zoo.plane("lo", n=4), zoo.plane("base"), zoo.plane("plate")
    plate.scale, plate.location.z = (0.3, 0.3, 1.0), 0.05
    report = bake(low, base, plate)
    proposal = weights.propose(bpy.context, report, NONE)
    assert all((weights == 0.5).all() for weights in proposal.weights.values())
    assert proposal.before == proposal.after == 0.0


def test_painted_weights_stay_where_no_others_are_better():
    low, highs = zoo.plane("lo", n=8), step_up()
    painted = np.where(x_of(low) < 0.0, np.float32(0.375), np.float32(0.5))
    names = NONE | {"offset_group": mesh_elements.write_weights(low, "far", painted)}
    report = bake(low, *highs, **STEP, **names)
    proposal = weights.propose(bpy.context, report, names)
    assert (proposal.weights["offset_group"][x_of(low) < -0.1] == 0.375).all()
    assert (proposal.weights["offset_group"][x_of(low) > 0.1] == 1.0).all()
    assert weights.apply(low, proposal, names)["offset_group"] == "far"


@pytest.mark.parametrize(
    ("left", "offset", "straight"),
    [
        ({}, 0.5, 0.5),
        ({("offset", 0.25): 8}, 0.5, 0.5),  # too few less
        ({("offset", 0.25): 7}, 0.25, 0.5),
        ({("offset", 0.25): 2, ("offset", 0.125): 3, ("straight", 1.0): 4}, 0.25, 0.5),
        ({("offset", 0.25): 3, ("offset", 0.125): 2, ("straight", 1.0): 4}, 0.125, 0.5),
        ({("offset", 0.0625): 6, ("offset", 0.0): 5}, 0.0, 0.5),
        ({("offset", 0.25): 3, ("straight", 1.0): 1}, 0.5, 1.0),
        ({("offset", 1.0): 0, ("straight", 0.0): 0}, 1.0, 0.5),  # the first of two
    ],
)
def test_the_trial_that_leaves_the_fewest_doubtful_texels_wins(left, offset, straight):
    """Of ten doubtful texels on a triangle, trials leave as many as `left` says."""
    proposal = weights.best(one_triangle(), lambda painted, _: traced(left.get(trial_of(painted), 10)))
    assert (proposal.weights["offset_group"] == offset).all()
    assert (proposal.weights["straight_group"] == straight).all()
    assert (proposal.before, proposal.after) == (0.1, min([10, *(n for n in left.values() if n < 8)]) / 100)


def test_weights_that_do_not_fit_together_are_not_proposed():
    """The trial leaves fewer doubtful texels, but what is made of all trials leaves more."""
    counts = iter([10, *[0] * len(weights.TRIALS), 10, 11])
    proposal = weights.best(one_triangle(), lambda *_: traced(next(counts)))
    assert all((weights == 0.5).all() for weights in proposal.weights.values())
    assert (proposal.before, proposal.after) == (0.1, 0.1)


def test_a_trial_that_changes_a_sure_texel_is_not_proposed():
    left = {("offset", 0.25): 2, ("offset", 0.125): 5}
    proposal = weights.best(
        one_triangle(),
        lambda painted, _: traced(left.get(trial_of(painted), 10), moved=trial_of(painted) == ("offset", 0.25)),
    )
    assert (proposal.weights["offset_group"] == 0.125).all()
    assert proposal.after == 0.05


def test_the_result_is_checked_on_more_texels():
    """What changes a sure texel there is taken back."""
    sizes = []

    def trace(painted, size):
        sizes.append(size)
        is_tried = trial_of(painted) == ("offset", 0.25)
        return traced(2 if is_tried else 10, moved=is_tried and size == weights.CHECKED_TEXELS)

    proposal = weights.best(one_triangle(), trace)
    assert all((weights == 0.5).all() for weights in proposal.weights.values())
    assert (proposal.before, proposal.after) == (0.1, 0.1)
    trials, checks = 1 + len(weights.TRIALS), 3
    assert sizes == [weights.TEXELS] * trials + [weights.CHECKED_TEXELS] * checks


def traced(doubtful, *, moved=False):
    """The rays of a hundred texels of one triangle, with as many doubtful ones. moved: whether the last one hits elsewhere."""
    hits = np.zeros((100, 3), np.float32)
    hits[-1] = moved
    number = np.arange(100)
    return unsure_texels.Traced(
        number * 0, hits * 0, hits, number * 0.0, number < 0, number < doubtful, number < doubtful, gap=1e-3, count=1
    )


def test_sure_texels_keep_their_surface():
    """A wavy shirt over a body, and a low shirt that lies between the two: less offset fixes some texels and harms others."""
    low = shells("lo", 0.311, waves=0.0, n=16)
    high = shells("hi", 0.325, waves=0.006, n=64)
    rays = {"maps": ("HEIGHT",), "depth": 32, "margin": 0, "width": 128, "height": 128}
    report = bake(low, high, **rays)
    heights = pixels("lo_height")
    is_sure = pixels(draw_mask(bpy.context, report, "unsure").name) == 0.0
    proposal = weights.propose(bpy.context, report, NONE)

    groups = weights.apply(low, proposal, NONE)
    bake(low, high, **rays, **groups)
    changed = np.abs(pixels("lo_height") - heights) > 1e-3

    assert proposal.after < proposal.before
    assert changed.any()
    assert not (changed & is_sure).any()


@pytest.mark.parametrize("seed", [0, 19, 85, 111])
def test_random_scenes_lose_no_texel_with_seed(seed):
    low, highs, settings = layered_scenes.make(seed)
    same = {"method": "CAST", "maps": ("HEIGHT",), "samples": 1, "margin": 0, "space": "OBJECT"} | NONE
    settings = replace(settings, **same)
    report = bake_pair(bpy.context, low, highs, settings)
    heights, is_hit = pixels("map_height"), pixels("map", 3) > 0.0
    is_unsure = pixels(draw_mask(bpy.context, report, "unsure").name) > 0.0
    groups = weights.apply(low, weights.propose(bpy.context, report, NONE), NONE)
    bake_pair(bpy.context, low, highs, replace(settings, **groups, **report.distances))
    assert (pixels("map", 3) > 0.0)[is_hit].all()
    assert np.allclose(pixels("map_height")[is_hit & ~is_unsure], heights[is_hit & ~is_unsure], atol=2e-3)


def shells(name, radius, waves, n):
    """A body of radius 0.3 and a shirt around it, side by side in UV space."""
    uv, quads = zoo.grid_uv(n, n), zoo.grid_faces(n, n)
    u, v = uv.T
    points = []
    for around, begin, length in ((0.3, 0.0, 1.2), (radius, 0.15, 0.8)):
        across = around + 0.05 * np.sin(np.pi * v) + waves * np.sin(2 * np.pi * (7 * u + 3 * v))
        points.append(
            np.stack([across * np.cos(2 * np.pi * u), across * np.sin(2 * np.pi * u), begin + length * v], axis=1)
        )
    cells = np.concatenate([(uv * (0.5, 1.0) + (0.5 * i, 0.0))[quads] for i in range(2)])
    return zoo.build(name, np.concatenate(points), np.concatenate([quads, quads + len(uv)]), cells)


def pixels(name, channel=0):
    """A channel of an image."""
    return np.array(bpy.data.images[name].pixels)[channel::4]


def one_triangle():
    mesh = Mesh(
        "lo", np.eye(3, dtype=np.float32), np.arange(3), np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]), np.eye(4)
    )
    return Meshes(mesh, [], None, mesh.normals, None, "", False, [])


def trial_of(painted):
    """What is painted on the first corner, if anything is."""
    offset, straight = painted.offset[0] / 2.0, (painted.straight[0] + 1.0) / 2.0
    return ("offset", offset) if offset != 0.5 else ("straight", straight) if straight != 0.5 else None


def test_writing_keeps_other_groups_and_adds_all_vertices():
    low = zoo.plane("lo", n=2)
    low.vertex_groups.new(name="other").add([0, 1], 0.25, "REPLACE")
    low.vertex_groups.new(name="far").add([3], 1.0, "REPLACE")
    values = np.float32([0.5, 0.5, 0.125, 1.0, 0.5, 0.5, 0.5, 0.5, 0.0])
    assert mesh_elements.write_weights(low, "far", values) == "far"
    far, other = mesh_elements.weights(low, low.data, ["far", "other"], outside=-1.0)
    assert np.array_equal(far, values)
    assert np.array_equal(other, [0.25, 0.25] + [-1.0] * 7)


def test_modifiers_may_not_change_the_vertices():
    low, highs = zoo.plane("lo", n=8), step_up()
    low.modifiers.new("Triangulate", "TRIANGULATE")
    report = bake(low, *highs, **STEP)
    assert (weights.propose(bpy.context, report, NONE).weights["offset_group"] == 1.0).any()
    low.modifiers.new("Mirror", "MIRROR").use_axis = (False, True, False)
    with pytest.raises(BakeError, match="'lo' add or remove vertices"):
        weights.propose(bpy.context, report, NONE)


def test_nothing_is_stored():
    low, highs = zoo.plane("lo", n=2), step_up()
    report = bake(low, *highs, **STEP)
    texels = list(bpy.data.images["lo_normal"].pixels)
    weights.propose(bpy.context, report, NONE)
    assert [image.name for image in bpy.data.images] == ["lo_normal"]
    assert list(bpy.data.images["lo_normal"].pixels) == texels
    assert not low.vertex_groups


def bake_file(path, **settings):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bake(bpy.data.objects["lo"], bpy.data.objects["hi"], **{"width": 256, "height": 256} | settings)


@pytest.mark.shared
@pytest.mark.parametrize(("name", "hit"), [("box", "OWN"), ("floaters", "OUTERMOST")])
def test_bolts_and_plates_stay(shared_assets, name, hit):
    report = bake_file(shared_assets / "layers" / f"{name}.blend", hit=hit)
    proposal = weights.propose(bpy.context, report, NONE)
    assert all((weights == 0.5).all() for weights in proposal.weights.values())


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize(("name", "left"), [("fingers", 0.02), ("collar", 0.5)])
def test_first_hits_of_other_layers_go(shared_assets, name, left):
    """The shares of the texels of another layer that are left: 0.003 and 0.44 where this was measured."""
    report = bake_file(shared_assets / "layers" / f"{name}.blend", hit="OUTERMOST")
    proposal = weights.propose(bpy.context, report, NONE)
    assert proposal.before > 0.1
    assert proposal.after < left * proposal.before


# Painted groups


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
