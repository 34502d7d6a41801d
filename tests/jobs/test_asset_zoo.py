# SPDX-License-Identifier: GPL-3.0-or-later
"""Game assets of random highs, most of them wrong in all ways at once: each ends in an asset whose faces and maps are right, or
in one sentence."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix
from mathutils.bvhtree import BVHTree

from addon.core.asset_limits import Wanted
from addon.core.errors import BakeError
from addon.core.naming import Suffixes
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.jobs import asset
from addon.jobs.job import Job
from addon.scene import mesh_reader
from tests.support import maps, quick_assets, random_cases, spoiled, wrong_highs, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

NEAR = 0.02
"""The share of the size within which other faces of the high mesh are as near as the nearest one: at a crease or an edge, or
where two sides of it are close, the nearest one alone does not tell the side."""
DEBRIS = 0.01
"""The share of the area of a low mesh below which a part is debris."""
CLEARLY = -0.1
"""The cosine between normals below which they oppose each other."""
FEWEST = 40
"""Triangles of a low mesh below which it cannot follow a ring: where it cuts across, no side is the right one."""


def tube(rng):
    """A ring with waves."""
    turns, waves = 3 * int(rng.integers(3, 12)), int(rng.integers(0, 4))
    i, j = np.meshgrid(np.arange(2 * turns), np.arange(turns), indexing="ij")
    around, across = np.pi * i / turns, 2.0 * np.pi * j / turns
    thick = 0.3 * (1.0 + 0.3 * np.sin(waves * around))
    points = np.stack(
        [(1.0 + thick * np.cos(across)) * np.cos(around), (1.0 + thick * np.cos(across)) * np.sin(around)]
        + [thick * np.sin(across)],
        axis=-1,
    )
    here, right = i * turns + j, (i + 1) % (2 * turns) * turns + j
    above, both = i * turns + (j + 1) % turns, (i + 1) % (2 * turns) * turns + (j + 1) % turns
    halves = [np.stack([here, right, both], axis=-1), np.stack([here, both, above], axis=-1)]
    return spoiled.Soup(points.reshape(-1, 3), np.concatenate([each.reshape(-1, 3) for each in halves]))


def of(obj):
    soup = spoiled.of_object(obj)
    bpy.data.objects.remove(obj)
    return soup


CLEAN = (
    tube,
    lambda rng: of(zoo.ball("ball", int(rng.integers(6, 24)))),
    lambda rng: of(zoo.cube("cube")),
    lambda rng: of(zoo.terrain("hills", int(rng.integers(8, 32)), height=0.2 * rng.random())),
    lambda rng: spoiled.joined(of(zoo.ball("ball", 8)), tube(rng)),
)
OPEN = 3
"""Which of them has a border."""


def placed(obj, rng):
    """An object of another size, uneven, and perhaps far from the origin."""
    obj.matrix_world = Matrix.LocRotScale(
        rng.choice([0.0, 1e4]) * rng.random(3),
        Euler(rng.random(3)),
        rng.choice([0.001, 1.0, 300.0]) * rng.uniform(0.3, 1.0, 3),
    )
    bpy.context.view_layer.update()
    return obj


def normals_of(corners):
    found = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300)


def turned(low, truth, origin):
    """How many triangles of a low object oppose each of the triangles (T, 3, 3) that are near their middle. Those of debris do
    not count: nothing tells their side. truth: relative to the origin, from which small objects may be so far that places in
    world space are too coarse in single precision."""
    soup = spoiled.of_object(low)
    matrix = np.array(low.matrix_world, np.float64)
    soup = replace(soup, points=mesh_reader.points(low.data) @ matrix[:3, :3].T + (matrix[:3, 3] - origin))
    center, size = truth.reshape(-1, 3).mean(axis=0), np.ptp(truth.reshape(-1, 3), axis=0).max()
    found, truth = (soup.points[soup.triangles] - center) / size, (truth - center) / size
    tree = BVHTree.FromPolygons(truth.reshape(-1, 3).tolist(), np.arange(3 * len(truth)).reshape(-1, 3).tolist())
    own, others, count = normals_of(found), normals_of(truth), 0
    for middle, normal in zip(found[~is_debris(soup)].mean(axis=1), own[~is_debris(soup)], strict=True):
        _, _, _, distance = tree.find_nearest(middle.tolist())
        near = [number for _, _, number, _ in tree.find_nearest_range(middle.tolist(), distance + NEAR)]
        count += bool(near and (others[near] @ normal).max() < CLEARLY)
    return count


def is_debris(soup):
    """Which triangles (T,) bool are in parts of less than DEBRIS of the area."""
    labels = np.arange(len(soup.points))
    for _ in labels:
        least = labels[soup.triangles].min(axis=1)
        before = labels.copy()
        for column in soup.triangles.T:
            np.minimum.at(labels, column, least)
        if (labels == before).all():
            break
    corners = soup.points[soup.triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    part = labels[soup.triangles[:, 0]]
    return np.bincount(part, areas)[part] < DEBRIS * areas.sum()


def made(high, rng, monkeypatch, fewest=4, side=64, *, quads=False):
    """The report of an asset and its low object. Raises BakeError. side: of the map, in texels."""
    quick_assets.quicken(monkeypatch)
    by_degrees = rng.random() < 0.3
    wanted = Wanted(
        degrees=float(rng.choice([5.0, 20.0])) if by_degrees else np.inf,
        triangles=0 if by_degrees else int(rng.choice([fewest, 50, 100, 400])),
        levels=int(rng.random() < 0.1),
        quads=quads,
    )
    settings = Settings(
        width=side,
        height=side,
        storage="MEMORY",
        margin=2,
        image="{low}_map",
        depth=32,
        maps=("AO",) if rng.random() < 0.3 else (),
    )
    task = asset.work(bpy.context, Job(high, [high]), wanted, settings, Pace(0.0), suffixes=Suffixes())
    return finish(task)


def check(reports):
    for report in reports:
        low = bpy.data.objects[report.low]
        points = mesh_reader.points(low.data)
        assert np.isfinite(points).all()
        assert np.isfinite(mesh_reader.uvs(low.data, low.data.uv_layers.active.name)).all()
        for image in bpy.data.images:
            assert np.isfinite(maps.pixels(image)).all(), image.name


def spoiled_surface(rng):
    """A high object, and the triangles (T, 3, 3) of what it was made of, relative to its origin."""
    kind = rng.integers(len(CLEAN))
    clean = dirty = CLEAN[kind](rng)
    if rng.random() < 0.7 and kind != OPEN:
        dirty = spoiled.all_together(clean, rng)
    elif kind == OPEN:  # what lies behind it would be seen, too, and no side of that is the right one
        dirty = spoiled.unwelded(spoiled.noisy(clean, rng, 0.02), rng, 0.1)
        dirty = spoiled.flipped_in_regions(spoiled.flipped_at_random(dirty, rng, 0.05), rng, 0.1)
    high = placed(spoiled.build("hi", dirty), rng)
    matrix = np.array(high.matrix_world, np.float64)
    return high, (clean.points.astype(np.float64) @ matrix[:3, :3].T)[clean.triangles]


outcomes = random_cases.counted(enough=16, assets=0.5, sentences=0.04)


@pytest.mark.parametrize("quads", [False, True], ids=["triangles", "quads"])
@random_cases.seeds(16, fast=1)
def test_any_high_becomes_an_asset_or_a_sentence(seed, quads, outcomes, monkeypatch):
    rng = np.random.default_rng(seed)
    high = wrong_highs.made(rng)
    before = snapshot()
    try:
        with np.errstate(invalid="raise", divide="raise"):
            reports = made(high, rng, monkeypatch, quads=quads)
    except BakeError as error:
        assert str(error).endswith(".")
        assert difference(before, snapshot()) == {}
        outcomes["sentences"] += 1
        return
    outcomes["assets"] += 1
    check(reports)


@random_cases.seeds(8, fast=1)
def test_a_spoiled_surface_becomes_an_asset_without_turned_faces(seed, monkeypatch):
    rng = np.random.default_rng(1000 + seed)
    high, truth = spoiled_surface(rng)
    reports = made(high, rng, monkeypatch, fewest=FEWEST, side=256)  # whose islands all have a place
    check(reports)
    for report in reports:
        if report.triangles["low"] < 0.9 * FEWEST:  # a level of detail
            continue
        assert turned(bpy.data.objects[report.low], truth, high.matrix_world.translation) == 0
