# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake is decided once, as a value."""

from collections import Counter
from dataclasses import FrozenInstanceError, replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core import progress
from addon.core.settings import Run, Settings
from addon.engine import baking, draw_order, orienting, planning, tree_cache, uv_agreement
from addon.engine.planning import plan_of
from addon.jobs import Job, masks
from addon.jobs.job import Request, read_meshes
from addon.jobs.live_session import Session
from addon.mesh import triangle_mesh
from addon.mesh.triangle_mesh import Mesh
from tests.engine.test_orienting import SAME, ball
from tests.engine.test_stacked_uvs import asymmetric, mirrored
from tests.support import maps, scenes, spoiled, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 48


def settings_of(**values):
    return Settings(**{"width": SIZE, "height": SIZE, "storage": "MEMORY", "margin": 0, "depth": 32} | values)


def spoiled_pair(seed, share=0.3):
    """A low sphere, a high one with turned faces, and which of its faces are."""
    low, soup = zoo.sphere("lo", n=16), spoiled.of_object(zoo.sphere("clean", n=32))
    is_flipped = spoiled.regions(soup, np.random.default_rng(seed), share)
    return low, spoiled.build("hi", spoiled.flipped(soup, is_flipped)), is_flipped


def planned(low, *highs, **values):
    settings = settings_of(**values)
    return plan_of(read_meshes(bpy.context, Request(Job(low, highs), settings)), settings)


DECISIONS = {
    "tiles": (planning, "tiles_to_bake"),
    "order": (draw_order, "order_of"),
    "method": (planning, "choose_method"),
    "agreement": (uv_agreement, "measure"),
    "orientation": (orienting, "orientation_of"),
}


@pytest.fixture
def counted(monkeypatch):
    """How often each decision was made."""
    counts = dict.fromkeys(DECISIONS, 0)

    def watch(what, module, name):
        meant = getattr(module, name)

        def decide(*given, **more):
            counts[what] += 1
            return meant(*given, **more)

        monkeypatch.setattr(module, name, decide)

    for what, (module, name) in DECISIONS.items():
        watch(what, module, name)
    return counts


@pytest.mark.parametrize("is_spoiled", [False, True])
def test_a_bake_decides_once_seed_4(counted, is_spoiled):
    low, high, _ = spoiled_pair(4, 0.3 if is_spoiled else 0.0)
    scenes.bake(low, high, method="AUTO")
    assert set(counted.values()) == {1}, counted


def test_a_plan_is_data_that_can_be_compared_seed_5():
    low, high, _ = spoiled_pair(5)
    plan, again = planned(low, high, method="CAST"), planned(low, high, method="CAST")
    assert plan.read is not again.read
    assert plan == again
    assert plan != planned(low, high, method="FLATTEN")
    assert plan != planned(low, high, method="CAST", keep_faces=True)
    with pytest.raises(FrozenInstanceError):
        plan.tiles = (1002,)
    scenes.move_uvs(low, offset=(0.01, 0.0))
    assert plan == planned(low, high, method="CAST"), "where the islands lie decides nothing"


def test_a_plan_has_masks_and_leaves_the_meshes_that_were_read_seed_6():
    low, high, is_flipped = spoiled_pair(6)
    settings = settings_of(method="CAST")
    read = read_meshes(bpy.context, Request(Job(low, [high]), settings))
    before = read.highs[0].triangles.copy()
    plan = plan_of(read, settings)
    assert plan.read is read
    assert np.array_equal(read.highs[0].triangles, before)
    assert np.array_equal(plan.masks[0].turned, is_flipped)
    assert np.array_equal((plan.highs[0].triangles != before).any(axis=1), is_flipped)
    # Made once, whoever asks, and for another plan with the same masks.
    assert plan.meshes.highs[0] is plan.highs[0]
    assert replace(plan, apart="").highs[0] is plan.highs[0]


def test_a_clean_mesh_is_drawn_as_the_object_that_was_read():
    low, high = zoo.sphere("lo", n=16), zoo.sphere("hi", n=32)
    settings = settings_of(method="CAST")
    read = read_meshes(bpy.context, Request(Job(low, [high]), settings))
    meshes = plan_of(read, settings).meshes
    assert meshes.highs[0] is read.highs[0]
    assert meshes.low is read.low


def test_what_is_left_out_is_a_mask_too_seed_9():
    rng = np.random.default_rng(9)
    clean, _ = ball(level=3)
    inner = spoiled.flipped_at_random(spoiled.replace(clean, points=0.95 * clean.points), rng, 0.3)
    is_flipped = spoiled.regions(clean, rng, 0.1)
    soup = spoiled.joined(spoiled.flipped(clean, is_flipped), inner)
    chosen = np.flatnonzero(~is_flipped)[:20]
    high = spoiled.build("hi", spoiled.joined(soup.at(chosen), soup))
    plan = planned(zoo.sphere("lo", n=16), high, method="AUTO")
    (masks,), (read,), (drawn,) = plan.masks, plan.read.highs, plan.highs
    outer = 20 + np.arange(len(clean.triangles))
    assert (plan.told.hidden, plan.told.twice) == (len(inner.triangles), 20)
    assert np.array_equal(np.flatnonzero(masks.copies), outer[chosen])
    kept = np.concatenate([np.arange(20), np.delete(outer, chosen)])
    assert np.array_equal(np.flatnonzero(~masks.left_out), kept)
    assert np.array_equal(masks.turned[outer], is_flipped)
    assert np.array_equal((drawn.triangles != read.triangles[kept]).any(axis=1), masks.turned_of_kept)
    assert masks.turned_of_kept.sum() == is_flipped.sum()


def test_distances_are_measured_between_what_is_left():
    low, soup = zoo.terrain("lo", 8), spoiled.of_object(zoo.terrain("quads", 32, height=0.05))
    for name, high in (("all", soup), ("some", spoiled.joined(soup, soup.at(np.arange(90))))):
        plan = planned(low, spoiled.build(name, high), method="AUTO")
        assert plan.method == "FLATTEN"
        assert (plan.choice.separation is None) == (name == "some")
    (masks,) = plan.masks
    assert np.array_equal(np.flatnonzero(masks.left_out), len(soup.triangles) + np.arange(90))
    assert masks.left_out.sum() == plan.told.twice


def test_flatten_builds_no_tree_for_clean_parts():
    """Only rays miss what an open part behind another layer should show."""
    low, highs = zoo.terrain("lo", 8), [zoo.terrain("hi", 24, height=0.1), zoo.terrain("other", 24, height=-0.2)]
    before = tree_cache.trees.built
    scenes.bake(low, *highs, method="FLATTEN")
    assert tree_cache.trees.built == before


def test_stacked_parts_have_their_order_in_the_plan():
    plan = planned(mirrored(), asymmetric(), method="CAST", stacked="FIRST")
    assert plan.order.is_any and plan.order.is_reversed
    assert sorted(plan.order.low) == list(range(len(plan.read.low.triangles)))
    assert np.array_equal(plan.meshes.low.triangles, plan.read.low.triangles[plan.order.low])
    assert plan.listed.highs[0] is plan.drawn_highs[0] is plan.read.highs[0]
    count = len(plan.read.low.triangles)
    of_set = replace(plan.read, whole=plan.read.low, kept=np.arange(count))  # a texture set of all triangles
    assert np.array_equal(plan.order.of(of_set).kept, plan.order.low)


def test_a_mesh_remembers_what_was_made_of_the_same_objects():
    mesh = Mesh.of_arrays("mesh", np.eye(3), np.array([[0, 1, 2]]))
    one, other = np.zeros(1), np.zeros(1)
    assert mesh.remembered("made", (one,), lambda: "first") == "first"
    assert mesh.remembered("made", (one,), lambda: "again") == "first"
    assert mesh.remembered("made", (other,), lambda: "of another") == "of another"
    assert replace(mesh, name="copy").remembered("made", (other,), lambda: "of the copy") == "of the copy"


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_bake_checks_and_live_draw_the_same_seed_8(method):
    low, soup = zoo.terrain("lo", 8), spoiled.of_object(zoo.terrain("quads", 32, height=0.15))
    high = spoiled.build("hi", spoiled.flipped_in_regions(soup, np.random.default_rng(8), 0.3))
    settings = settings_of(method=method, space="OBJECT", modifiers="VIEWPORT", image="map", material=False)
    baked = maps.bake(low, high, size=(SIZE, SIZE), method=method, space="OBJECT")
    drawing = progress.finish(baking.draw(planned(low, high, method=method, space="OBJECT"), Run(settings)))
    ((texels, _),) = progress.finish(drawing.texels(1001)).values()
    raw = progress.finish(drawing.renderer.raw(1001))["NORMAL"]
    session = Session(bpy.context, Job(low, [high]), settings, progress.Pace())
    session.run(bpy.context)
    for found in (texels, session.texels, np.dstack([0.5 * raw[..., :3] + 0.5, np.abs(raw[..., 3])])):
        assert np.array_equal(found[..., :3], baked[..., :3])
    assert session.plan == drawing.plan
    session.free()


def test_the_mask_of_a_check_decides_once(counted):
    low, high, _ = spoiled_pair(2)
    report = scenes.bake(low, high, method="CAST")
    counted.update(dict.fromkeys(counted, 0))
    masks.draw_mask(bpy.context, report, "unsure")
    assert max(counted.values()) == 1, counted
    assert counted["tiles"] == 0, "the report has them"


def test_live_decides_anew_only_what_a_stroke_changes(counted):
    low, high, still = zoo.terrain("lo", 8), zoo.terrain("hi", 24, height=0.1), zoo.terrain("still", 24, height=-0.2)
    for obj in (high, still):
        soup = spoiled.of_object(obj)
        spoiled.build(f"{obj.name} spoiled", spoiled.flipped_in_regions(soup, np.random.default_rng(1), 0.3))
    highs = [bpy.data.objects[f"{name} spoiled"] for name in ("hi", "still")]
    settings = settings_of(method="FLATTEN", modifiers="VIEWPORT")
    session = Session(bpy.context, Job(low, highs), settings, progress.Pace())
    session.run(bpy.context)
    first = session.plan
    counted.update(dict.fromkeys(counted, 0))
    highs[0].data.attributes["position"].data[300].vector[2] += 0.05
    highs[0].data.update()
    bpy.context.view_layer.update()
    session.run(bpy.context, {highs[0].session_uid})
    assert (counted["order"], counted["method"], counted["orientation"]) == (0, 0, 0)
    assert session.plan.masks == first.masks
    assert session.plan.highs[1] is first.highs[1]
    assert session.plan.highs[0] is not first.highs[0]
    session.free()


def test_the_content_of_each_mesh_is_compared_once_seed_3(monkeypatch):
    """To find trees in the cache: by the trials of its sides, by the bake and by the checks."""
    low, high, _ = spoiled_pair(3)
    summed = []
    crc32 = triangle_mesh.zlib.crc32
    monkeypatch.setattr(
        triangle_mesh, "zlib", SimpleNamespace(crc32=lambda array: summed.append(array) or crc32(array))
    )
    scenes.bake(low, high, method="CAST")
    large = Counter(array.ctypes.data for array in summed if array.size > 16)
    assert max(large.values()) == 2, "vertices of the mesh as it was read, and with its changes"


def test_live_decides_anew_for_another_low_mesh(counted):
    low, high = mirrored(), asymmetric()
    margin = {"margin": 8, "margin_type": "ADJACENT_FACES"}
    settings = settings_of(method="CAST", space="OBJECT", modifiers="VIEWPORT", **margin)

    def session():
        return Session(bpy.context, Job(low, [high]), settings, progress.Pace())

    live = session()
    live.run(bpy.context)
    first = live.plan
    counted.update(dict.fromkeys(counted, 0))
    low.modifiers["Mirror"].use_mirror_u = True  # nothing shares texels any more
    scenes.move_uvs(low, (0.4, 0.7), offset=(0.05, 0.1))
    bpy.context.view_layer.update()
    live.run(bpy.context, {low.session_uid})
    assert (counted["order"], counted["orientation"], counted["method"]) == (1, 1, 0)
    assert first.order.is_any and not live.plan.order.is_any
    anew = session()
    anew.run(bpy.context)
    assert np.array_equal(live.texels, anew.texels)
    for each in (live, anew):
        each.free()


@pytest.mark.parametrize("far", [0, 1, 2])
def test_a_high_mesh_out_of_reach_is_named_in_any_order(far):
    low, highs = mirrored(), [asymmetric("one"), asymmetric("two"), asymmetric("three")]
    highs[far].location.x = 50.0
    bpy.context.view_layer.update()
    plan = planned(low, *highs, method="CAST", stacked="FIRST")
    names = [high.name for high in highs]
    assert plan.order.is_reversed
    assert plan.warnings == [f"{names[far]!r} lies out of reach of the rays and was left out."]
    assert [high.name for high in plan.meshes.listed_highs] == names[:far] + names[far + 1 :]
    assert [high.name for high in plan.drawn_highs] == names[:far] + names[far + 1 :]
    assert [high.name for high in plan.listed.highs] == names


def test_live_decides_anew_for_other_triangles_seed_8(counted):
    low, soup = zoo.terrain("lo", 8), spoiled.of_object(zoo.terrain("quads", 24, height=0.15))
    high = spoiled.build("hi", spoiled.flipped_in_regions(soup, np.random.default_rng(8), 0.3))
    settings = settings_of(method="FLATTEN", space="OBJECT", modifiers="VIEWPORT")
    session = Session(bpy.context, Job(low, [high]), settings, progress.Pace())
    session.run(bpy.context)
    before = session.texels.copy()
    counted.update(dict.fromkeys(counted, 0))
    high.data.flip_normals()
    bpy.context.view_layer.update()
    session.run(bpy.context, {high.session_uid})
    assert (counted["order"], counted["orientation"]) == (0, 1)
    assert np.abs(session.texels - before).max() < SAME
    session.free()
