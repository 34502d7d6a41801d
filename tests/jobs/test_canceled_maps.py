# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake that is canceled or fails in the middle of any kind of map leaves Blender, files and the GPU's state alone."""

from itertools import islice
from types import SimpleNamespace

import bpy
import gpu
import numpy as np
import pytest

from addon.core import progress
from addon.core.errors import BakeError
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import map_families, material_maps, ray_maps, sampling, tree_cache
from addon.jobs import Job, bake_all, bake_jobs, bake_pair
from addon.passes import target
from tests.support import lanes, scenes, zoo
from tests.support.feeds import write_png
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")


MAPS = ("POSITION", "AO", "BENT_NORMAL", "BASE_COLOR", "ATTRIBUTE", "THICKNESS", "CURVATURE")
FAMILIES = {
    "points": (map_families.PointMaps, "add"),
    "colors": (material_maps.MaterialMaps, "add"),
    "occlusion": (ray_maps.OpennessMaps, "add"),
    "thickness": (ray_maps.ThicknessMaps, "add"),
    "curvature": (ray_maps.CurvatureMaps, "add"),
    "detail": (material_maps.OwnNormals, "apply"),
}


def pair(folder):
    """A low plane with a material, and a high terrain that shows a file that is not loaded, and a normal map."""
    low, high = zoo.plane("lo", 2), zoo.terrain("hi", 24)
    scenes.material("Skin", low)
    material = bpy.data.materials.new("painted")
    rng = np.random.default_rng(0)
    color = bpy.data.images.load(write_png(folder / "color.png", rng.integers(0, 255, (16, 16, 3)).astype(np.uint8)))
    flat = scenes.image("bumps", np.full((8, 8, 3), (0.6, 0.5, 0.9)), space="Non-Color")
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    material.node_tree.links.new(scenes.texture(material, flat).outputs["Color"], node.inputs["Color"])
    scenes.set_inputs(
        material, Base_Color=scenes.texture(material, color).outputs["Color"], Normal=node.outputs["Normal"]
    )
    high.data.materials.append(material)
    high.data.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    color.buffers_free()
    return low, high


def settings_for(folder, method, **options):
    values = {"storage": "FILE", "output": str(folder / "maps" / "map.png"), "vertex_domain": "CORNER", **options}
    return Settings(
        method=method, width=64, height=64, samples=4, rays=32, depth=8, maps=MAPS, connect_maps=True, **values
    )


def gpu_state():
    target.clear(target.Target(1, 1, ("RGBA32F",)))  # before something is drawn, Vulkan has no viewport
    return {
        "blend": gpu.state.blend_get(),
        "depth": gpu.state.depth_test_get(),
        "mask": gpu.state.depth_mask_get(),
        "viewport": tuple(gpu.state.viewport_get()),
        "scissor": tuple(gpu.state.scissor_get()),
        "framebuffer": gpu.state.active_framebuffer_get() is None,
    }


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_a_bake_may_end_at_each_step(method, tmp_path):
    """Pages, rays and maps are steps of their own: each family is interrupted."""
    low, high = pair(tmp_path)
    settings = settings_for(tmp_path, method)
    (tmp_path / "maps").mkdir()
    before, there, state = snapshot(), files(tmp_path), gpu_state()
    seen, number = set(), 0
    while True:
        work = bake_jobs.work(bpy.context, [Job(low, [high])], settings, Pace(0.0))
        steps = list(islice(work, number + 1))  # and not one more, as zip takes
        if len(steps) <= number:
            break  # it was finished
        work.close()
        seen.add(steps[-1].what)
        assert difference(before, snapshot()) == {}, steps[-1].what
        assert files(tmp_path) == there
        assert gpu_state() == state
        number += 1 + number // 8
    assert {what.split()[0] for what in seen} >= {"Reading", "Drawing", "Casting"}, seen
    assert difference(before, snapshot()) != {}


ERRORS = [BakeError("The disk is full."), MemoryError(), RuntimeError("no texture")]


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("error", lanes.slow_but(ERRORS[:1], ERRORS), ids=repr)
def test_a_family_that_fails_leaves_all_as_it_was(family, error, tmp_path, monkeypatch):
    low, high = pair(tmp_path)
    settings = settings_for(tmp_path, "FLATTEN" if family in ("points", "occlusion", "detail") else "CAST")
    (tmp_path / "maps").mkdir()
    before, there, state = snapshot(), files(tmp_path), gpu_state()
    kind, name = FAMILIES[family]
    draw = getattr(kind, name)

    def failing(self, drawn):
        yield from draw(self, drawn)
        raise error

    monkeypatch.setattr(kind, name, failing)
    with pytest.raises(type(error)):
        bake_pair(bpy.context, low, [high], settings)
    assert difference(before, snapshot()) == {}
    assert files(tmp_path) == there
    assert gpu_state() == state
    monkeypatch.undo()
    assert bake_pair(bpy.context, low, [high], settings).maps.keys() == {name.lower() for name in MAPS}


def test_an_image_that_breaks_while_it_is_drawn_is_named(tmp_path, monkeypatch):
    """The file of a page is replaced after its size was read."""
    low, high = pair(tmp_path)
    settings = settings_for(tmp_path, "CAST")
    (tmp_path / "maps").mkdir()
    before = snapshot(without=("images",))
    bpy.data.images["color.png"].buffers_free()  # the snapshot has loaded it
    names = bpy.data.images.keys()
    work = bake_jobs.work(bpy.context, [Job(low, [high])], settings, Pace(0.0))
    next(step for step in work if step.what == "Drawing")
    (tmp_path / "color.png").write_bytes(b"no picture")
    with pytest.raises(BakeError, match="color"):
        list(work)
    assert difference(before, snapshot(without=("images",))) == {}
    assert bpy.data.images.keys() == names
    assert not files(tmp_path / "maps")


def test_several_jobs_keep_those_that_are_done(tmp_path):
    """The second job is canceled in the middle of its rays."""
    low, high = pair(tmp_path)
    second = zoo.plane("second", 2)
    settings = settings_for(tmp_path, "FLATTEN", storage="PACK", output="")
    jobs, steps = [Job(low, [high]), Job(second, [high])], []
    work = bake_jobs.work(bpy.context, jobs, settings, Pace(0.0))
    while not (steps and steps[-1].finished == 1 and steps[-1].what.startswith("Casting")):
        steps.append(next(work))
    work.close()
    assert [step.report.low for step in steps if step.report] == ["lo"]
    assert not [image.name for image in bpy.data.images if image.name.startswith("second")]
    assert len(bake_all(bpy.context, jobs, settings)) == 2


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize("kept", [1, 2**29])
def test_the_bar_never_goes_back(method, kept, tmp_path, monkeypatch):
    """Also where images are loaded for one sample after another."""
    monkeypatch.setattr(sampling, "KEPT_BYTES", kept)
    low, high = pair(tmp_path)
    steps = bake_jobs.work(bpy.context, [Job(low, [high])], settings_for(tmp_path, method), Pace(0.0))
    done = [step.done for step in steps]
    assert len(done) > 20
    assert done == sorted(done)
    assert done[-1] == 1.0


# Stage times


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("share_image", [False, True])
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_stages_add_up_to_the_total_without_waiting(method, share_image, monkeypatch):
    clock = SimpleNamespace(now=0.0)

    def tick():
        clock.now += 1.0  # each look at the clock takes a second
        return clock.now

    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=tick))
    tree_cache.trees.free()
    jobs = [Job(zoo.plane("lo"), [zoo.terrain("hi")])]
    settings = Settings(method=method, width=32, height=32, image="map", storage="MEMORY", material=False)
    work = bake_jobs.work(bpy.context, jobs, settings, Pace(0.01), share_image=share_image)
    try:
        while True:
            next(work)
            clock.now += 1e6
    except StopIteration as end:
        (report,) = end.value
    stages = {stage: seconds for stage, seconds in report.seconds.items() if stage != "total"}
    assert stages["draw"] > 0.0 and (stages["tree"] > 0.0) == (method == "CAST")
    assert 0.0 < sum(stages.values()) <= report.seconds["total"] < 1e6
