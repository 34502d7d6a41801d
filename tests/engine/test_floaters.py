# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that float over others: they give detail, and shade nothing."""

import bpy
import numpy as np
import pytest

from addon.core.progress import finish
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import Job, bake_all, part_state
from addon.passes import hemisphere
from addon.scene import object_checks
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIZE, GAP, HALF = 32, 0.02, 0.5
LAYER_BELOW = "NEAREST"
"""The hit that shows the plane below the plate."""


def plate_over_plane(*, is_marked, gap=GAP):
    """A low plane, the same high one, and a plate above its middle."""
    low, ground, plate = zoo.plane("low", 2), zoo.plane("ground", 2), zoo.plane("plate", 1, slope=0.02)
    plate.scale, plate.location = (HALF, HALF, 1.0), (0.0, 0.0, gap)
    plate.imprint_is_floater = is_marked
    return low, [ground, plate]


def baked(low, highs, *, jobs=(), **settings):
    values = {"method": "CAST", "maps": ("AO", "BENT_NORMAL"), "rays": 256, "material": False, "storage": "MEMORY"}
    values |= {"two_sided": True, "margin": 0, "extrusion": 0.1, "max_distance": 0.2} | settings
    own = Settings(**values, width=SIZE, height=SIZE)
    bake_all(bpy.context, [Job(low, highs), *jobs], own)
    return {name: pixels(f"{low.name}_{name}") for name in ("normal", "ao", "bent_normal")}


def pixels(name):
    image = bpy.data.images[name]
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(SIZE, SIZE, 4)


def middle(values):
    """The texels whose points lie under the plate, well within it."""
    return values[SIZE // 2 - 4 : SIZE // 2 + 4, SIZE // 2 - 4 : SIZE // 2 + 4]


@pytest.mark.parametrize("is_marked", [False, True])
def test_a_plate_shades_what_is_below_it_unless_it_floats(is_marked):
    """From below, the plate of half-width 0.5 at a height of 0.02 covers all but some thousandths of the hemisphere."""
    ao = baked(*plate_over_plane(is_marked=is_marked), hit=LAYER_BELOW)["ao"][..., 0]
    if is_marked:
        np.testing.assert_array_equal(ao, 1.0)
    else:
        assert middle(ao).max() < 0.02


def test_bent_normals_see_through_it():
    bent = baked(*plate_over_plane(is_marked=True), hit=LAYER_BELOW)["bent_normal"]
    np.testing.assert_allclose(bent[..., 2], 1.0, atol=0.01)


def test_its_own_texels_keep_their_detail_and_are_shaded_by_the_rest():
    """Shown from outside, the plate has its normals, which lean, and its occlusion is that of the wall beside it."""
    shaded = []
    for is_marked in (False, True):
        low, highs = plate_over_plane(is_marked=is_marked)
        wall = zoo.plane("wall", 1)
        wall.rotation_euler.y, wall.location = np.pi / 2.0, (-0.6, 0.0, 0.0)
        maps = baked(low, [*highs, wall], hit="OUTERMOST")
        shaded.append(middle(maps["ao"]).copy())
        assert np.abs(middle(maps["normal"])[..., 0] - 0.5).min() > 0.005  # not that of the plane
        for obj in (low, *highs, wall):
            bpy.data.objects.remove(obj)
    assert shaded[0].min() < 0.9
    np.testing.assert_allclose(shaded[1], shaded[0], atol=0.02)


def test_all_may_float():
    low, highs = plate_over_plane(is_marked=True)
    highs[0].imprint_is_floater = True
    np.testing.assert_array_equal(baked(low, highs, hit=LAYER_BELOW)["ao"][..., 0], 1.0)


@pytest.mark.parametrize("occluders", ["OWN", "ALL", "SCENE"])
def test_a_floater_of_another_low_object_shades_neither(occluders):
    low, (ground, plate) = plate_over_plane(is_marked=True)
    jobs = []
    if occluders == "ALL":
        jobs = [Job(zoo.plane("other", 2), [plate])]
        jobs[0].low.location.z = GAP
    ao = baked(low, [ground], jobs=jobs, occluders=occluders)["ao"]
    np.testing.assert_array_equal(ao[..., 0], 1.0)


def test_without_a_floater_nothing_changes(monkeypatch):
    """The tables of the surface are used, and no second tree is built."""
    low, highs = plate_over_plane(is_marked=False)
    tables, add = [], hemisphere.add_openness
    record = lambda sums, rays, occluders: tables.append(occluders.tables) or add(sums, rays, occluders)  # noqa: E731
    monkeypatch.setattr(hemisphere, "add_openness", record)
    baked(low, highs)
    assert set(tables) == {None}
    before = tree_cache.trees.built
    baked(low, highs)
    assert tree_cache.trees.built == before
    highs[1].imprint_is_floater = True
    baked(low, highs)
    assert tree_cache.trees.built == before + 1


def test_a_job_can_name_floaters_that_no_mark_says():
    low, highs = plate_over_plane(is_marked=False)
    job = Job(low, highs, floaters=[highs[1].session_uid])
    values = {"method": "CAST", "maps": ("AO",), "rays": 64, "material": False, "storage": "MEMORY", "hit": LAYER_BELOW}
    own = Settings(**values, two_sided=True, margin=0, extrusion=0.1, max_distance=0.2, width=SIZE, height=SIZE)
    bake_all(bpy.context, [job.but(size=0)], own)
    np.testing.assert_array_equal(pixels("low_ao")[..., 0], 1.0)


def test_the_mark_is_kept_without_the_add_on():
    _, (ground, plate) = plate_over_plane(is_marked=True)
    assert plate[object_checks.FLOATER] and object_checks.is_floater(plate.copy())
    plate.imprint_is_floater = False
    assert object_checks.FLOATER not in plate
    assert not object_checks.is_floater(ground)


@pytest.mark.parametrize(("maps", "is_changed"), [(("AO",), True), (("POSITION",), False)])
def test_a_mark_makes_maps_of_occlusion_old(maps, is_changed):
    low, highs = plate_over_plane(is_marked=False)
    settings = Settings(maps=maps, width=SIZE, height=SIZE, method="CAST")
    before = finish(part_state.look(bpy.context, Job(low, highs), settings))
    highs[1].imprint_is_floater = True
    now = finish(part_state.look(bpy.context, Job(low, highs), settings))
    assert bool(part_state.changes(before, now)) == is_changed
