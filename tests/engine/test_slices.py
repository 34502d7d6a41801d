# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that nothing that a bake draws keeps a slow GPU busy for long, and that it fits in little memory: the engine's own
passes, on simulated GPUs."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from addon.core.map_types import NAMES
from addon.core.material_feeds import BumpFeed, HighMaterial, ImageFeed, ImagePixels, NormalMapFeed
from addon.core.progress import Pace, finish
from addon.core.settings import Run, Settings
from addon.engine import baking, bands, ray_distances, sources
from addon.engine.method_choice import Choice
from addon.engine.planning import Plan
from addon.mesh.inputs import Meshes
from addon.mesh.triangle_mesh import TANGENTS, UV_LAYER, Mesh
from addon.passes import allocation, high_in_uv, target
from tests.support import lanes
from tests.support.simulated_gpu import GPUS, SimulatedGpu

LONGEST = 0.5
"""Seconds. Windows resets a GPU that is busy for 2 seconds, and scenes are denser than those of the table of speeds."""
CELLS = 16
"""Quads along each side of a rectangle."""
LAYOUTS = {
    "full": [(0.0, 0.0, 1.0, 1.0)],
    "empty rows below": [(0.0, 0.25, 1.0, 1.0)],
    "5 % below, 95 % above": [(0.0, 0.0, 0.05, 0.5), (0.0, 0.5, 0.95, 1.0)],
}
"""Rectangles of UV islands: u and v from and to."""
FAMILIES = {
    "normals": {},
    "samples": {"samples": 4, "adaptive": False},
    "occlusion": {"maps": ("AO", "BENT_NORMAL"), "rays": 64},
    "thickness, curvature": {"maps": ("THICKNESS", "CURVATURE"), "rays": 256},
    "images": {"maps": ("BASE_COLOR", "HEIGHT"), "detail_maps": True},
    "first hit": {"hit": "OUTERMOST"},
}
IMAGE = ImageFeed("image")


def mesh(name, rectangles, height=0.0):
    """A plane of rectangles, at the places of their UVs."""
    line = np.linspace(0.0, 1.0, CELLS + 1)
    x, y = (side.ravel() for side in np.meshgrid(line, line))
    first = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).ravel()
    quad = np.stack([first, first + 1, first + CELLS + 2, first, first + CELLS + 2, first + CELLS + 1], axis=1)
    uv = np.concatenate([np.stack([u0 + (u1 - u0) * x, v0 + (v1 - v0) * y], axis=1) for u0, v0, u1, v1 in rectangles])
    triangles = np.concatenate([quad.reshape(-1, 3) + number * len(x) for number in range(len(rectangles))])
    found = Mesh.of_arrays(name, np.column_stack([uv, np.full(len(uv), height)]), triangles, uv)
    corners = len(found.vertices)
    layers = {(UV_LAYER, ""): found.uv, (TANGENTS, ""): np.tile(np.float32((1, 0, 0, 1)), (corners, 1))}
    return replace(found, layers=layers)


def meshes_of(rectangles, *, has_detail):
    low, high = mesh("low", rectangles), mesh("high", rectangles, 0.001)
    of = Meshes.of(low, [high])
    labels = np.ones((len(high.triangles), 2), np.float32)
    detail = BumpFeed(IMAGE, below=NormalMapFeed(IMAGE)) if has_detail else None
    material = HighMaterial("material", {"Base Color": IMAGE}, detail)
    return replace(
        of,
        basis=replace(low, tangents=low.layers[TANGENTS, ""]),
        highs=[replace(high, labels=labels)],
        materials=[material],
        load_image=lambda _key, _tile: ImagePixels(np.zeros((64, 64, 4), np.float32), is_byte=True),
    )


def covered_by(rectangles, band):
    """How many texels of rows of a band the rectangles cover, exactly."""
    width, height = band.size

    def covered(across, up, rows):
        if (across, up) != (band.width, band.height):
            return across * len(rows)
        y = (np.array(rows) + band.start - band.halo + 0.5) / height
        return sum(float(((v0 <= y) & (y < v1)).sum()) * (u1 - u0) * width for u0, v0, u1, v1 in rectangles)

    return covered


def draw(simulated, rectangles, size, pace, *, combined=False, **values):
    """Draw all maps of a bake, with their margins. Returns the rows of a band, and the bytes of a texel that are told."""
    fixed = {"extrusion": 0.01, "max_distance": 0.02, "margin_type": "ADJACENT_FACES", "margin": 64}
    settings = Settings(**{"method": "CAST", "width": size, "height": size, **fixed, **values})
    run = Run(settings, pace)
    meshes = meshes_of(rectangles, has_detail=settings.map.detail_maps)
    meshes = meshes if settings.map.space == "TANGENT" else replace(meshes, basis=None)
    plan = Plan(meshes, (1001,), Choice(settings.tracing.method))
    if combined:
        rays = finish(ray_distances.measured_rays(plan.meshes, [1001], settings, run.timings))
        drawing = baking.Drawing(plan, sources.FlatAndRays(plan.meshes, rays, run), run)
    else:
        drawing = finish(baking.draw(plan, run))
    maps = drawing.maps
    of_map = list(bands.bands(size, size, settings.sampling.margin, texel_bytes=maps.texel_bytes))
    for band in of_map:
        simulated.covered = covered_by(rectangles, band)
        for name, drawn in finish(maps.of(band)):
            drawing.processes[name].draw(band, drawn).finish()
    return of_map[0].height, maps.texel_bytes


@pytest.fixture
def simulate(monkeypatch, gpu_context):
    def install(gpu):
        simulated = SimulatedGpu(GPUS[gpu])
        simulated.install(monkeypatch)
        return simulated

    with target.using(target.TargetPool()):
        yield install


def check(simulated):
    worst = max(simulated.longest, key=simulated.longest.get)
    print(f"longest {simulated.longest[worst]:.3f} s: {worst}; between waits {simulated.submitted:.3f} s")
    assert simulated.longest[worst] <= LONGEST, worst
    assert simulated.submitted <= 2.0 * LONGEST


SLOW = "samples"
"""The family of which a case takes seconds here. It has each layout in each size, on one GPU in turn."""
SIZED = list(itertools.product(LAYOUTS, [4096, 8192]))
CASES = [
    (gpu, family, *sized)
    for (i, gpu), family, (j, sized) in itertools.product(enumerate(GPUS), FAMILIES, enumerate(SIZED))
    if family != SLOW or i == (j + 2) % len(GPUS)  # the fast one is among them
]
FAST = [
    (list(GPUS)[j % len(GPUS)], family, list(LAYOUTS)[j % len(LAYOUTS)], (4096, 8192)[j % 2])
    for j, family in enumerate(FAMILIES)
]
IN_TURN = [(gpu, list(LAYOUTS)[i % len(LAYOUTS)]) for i, gpu in enumerate(GPUS)]


@pytest.mark.parametrize("case", lanes.slow_but(FAST, CASES), ids=str)
def test_no_dispatch_is_long(simulate, case):
    gpu, family, layout, size = case
    simulated = simulate(gpu)
    draw(simulated, LAYOUTS[layout], size, Pace(), **FAMILIES[family])
    check(simulated)


@pytest.mark.parametrize("case", lanes.slow_but(IN_TURN, itertools.product(GPUS, LAYOUTS)), ids=str)
@pytest.mark.parametrize("family", ["normals", "occlusion"])
def test_no_dispatch_of_a_window_is_long(simulate, case, family):
    gpu, layout = case
    simulated = simulate(gpu)
    draw(simulated, LAYOUTS[layout], 4096, Pace(0.06, has_picture=False), **FAMILIES[family])
    check(simulated)


@pytest.mark.parametrize("case", lanes.slow_but(IN_TURN, itertools.product(GPUS, LAYOUTS)), ids=str)
def test_no_dispatch_of_flatten_is_long(simulate, case):
    gpu, layout = case
    simulated = simulate(gpu)
    draw(simulated, LAYOUTS[layout], 8192, Pace(), method="FLATTEN", maps=("AO", "BASE_COLOR"), detail_maps=True)
    draw(simulated, LAYOUTS[layout], 8192, Pace(), combined=True)
    check(simulated)


@pytest.mark.parametrize("gpu", GPUS)
def test_millions_of_triangles_are_drawn_in_pieces(simulate, gpu):
    simulated = simulate(gpu)
    into, count = target.Target(4096, 4096, ("RGBA32F",)), 2**24
    high_in_uv.draw_normals_in_steps(into, (None, np.eye(3)), count, (1.0, 1.0, 0.0, 0.0))
    high_in_uv.draw_hits(into, None, count, (1.0, 1.0, 0.0, 0.0))
    assert sum(simulated.rows["bake/flatten_frag.glsl"]) == sum(simulated.rows["bake/flat_hits_frag.glsl"]) == count
    check(simulated)


MIB = 2**20
PBR = ("AO", "CURVATURE", "HEIGHT", "BASE_COLOR", "ROUGHNESS", "METALLIC")
BAKES = {
    "normal map": {},
    "normal map, Flatten": {"method": "FLATTEN"},
    "normal map, 4 samples, Flatten": {"method": "FLATTEN", "samples": 4},
    "normal map, 64 adaptive samples": {"samples": 64, "detail_maps": False},
    "normal map in the low object's space": {"space": "OBJECT", "maps": ("WIDENED_ROUGHNESS",)},
    "six maps": {"maps": PBR},
    "six maps, 4 samples": {"maps": PBR, "samples": 4},
    "all maps": {"maps": NAMES, "detail_maps": True},
    "all maps, 4 samples": {"maps": NAMES, "detail_maps": True, "samples": 4},
    "all maps, 4 samples, Flatten": {"method": "FLATTEN", "maps": NAMES, "detail_maps": True, "samples": 4},
    "all maps, 4 samples, both": {"combined": True, "maps": NAMES, "detail_maps": True, "samples": 4},
}


@pytest.fixture
def peaks(monkeypatch):
    """The most bytes that a pool of targets holds."""
    found = {"bytes": 0}
    get = target.TargetPool.get

    def noted(pool, *wanted):
        made = get(pool, *wanted)
        found["bytes"] = max(found["bytes"], pool.bytes)
        return made

    monkeypatch.setattr(target.TargetPool, "get", noted)
    return found


SPACES = [(4096, 512), (4096, 1536), (8192, 1536)]
"""The texels along a side of a map, and the megabytes that targets may take."""


@pytest.mark.parametrize("space", lanes.slow_but(SPACES[:1], SPACES), ids=str)
@pytest.mark.parametrize("name", BAKES)
def test_targets_fit_the_budget(simulate, peaks, name, space):
    """And take almost what is told before a bake."""
    size, megabytes = space
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(allocation, "BUDGET", megabytes * MIB)
        tallest, texel = draw(simulate("RTX 3060"), LAYOUTS["full"], size, Pace(), margin=16, **BAKES[name])
    print(f"{peaks['bytes'] / 2**30:.2f} GiB, {peaks['bytes'] / (tallest * size):.0f} bytes of {texel} for each texel")
    assert peaks["bytes"] <= megabytes * MIB
    assert peaks["bytes"] >= 0.85 * texel * tallest * size
