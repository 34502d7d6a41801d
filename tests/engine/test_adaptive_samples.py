# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests adaptive samples: against all samples in every texel, and how many samples texels take."""

import bpy
import gpu
import numpy as np
import pytest

from addon.core.declarations import adaptive_samples
from addon.core.declarations.map_settings import MAP
from addon.core.map_types import NORMAL
from addon.core.settings import Settings
from addon.engine import bands
from addon.engine.adaptive import adaptive_normals
from addon.jobs import Job, bake_all, bake_pair
from addon.passes import target
from addon.passes.adaptive import active, cell_samples, rounds
from addon.passes.bake import samples
from tests.support import angles, maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

METHODS = ["FLATTEN", "CAST"]


@pytest.fixture(autouse=True)
def adaptive_from_four_samples(monkeypatch):
    """Flatten's adaptive samples are as exact as those of rays, whatever number makes them faster."""
    monkeypatch.setitem(adaptive_samples.LEAST, "FLATTEN", 4)


RAYS = {"extrusion": 0.3, "max_distance": 0.6}
ALLOWED_P99 = 0.02
"""Degrees between the mean of adaptive samples and that of all samples."""
COUNTS = [count for count in MAP["samples"].values if count > 2]
PAIRS = [
    "kepler_199712_9079",
    "sthelens_290088_9079",
    "spot_1696_536",
    "spot_control_vs_subd5",
    "shaderball_48048_23378",
    "shaderball_61644_20517",
    "king_40480_4000",
    "helmet_23358_6117",
    "normaltangenttest_published",
]
OTHER_LAYOUT = "normaltangenttest_published", "FLATTEN"
"""Both meshes have UV layouts of their own."""
FAST = ["king_40480_4000", "spot_1696_536"]


def both(low, high, method, **settings):
    """The maps with adaptive samples and with all samples, and the share that stopped early."""
    rays = RAYS if method == "CAST" else {}
    values = {"method": method, "margin": 0, "depth": 32, "storage": "MEMORY", "material": False, **rays, **settings}
    found, stopped = [], []
    for adaptive in (True, False):
        report = bake_pair(bpy.context, low, [high], Settings(image="map", adaptive=adaptive, **values))
        found.append(maps.pixels(bpy.data.images["map"]))
        stopped.append(report.stopped_early)
    assert stopped[1] == 0.0
    return *found, stopped[0]


def difference(some, every):
    """Degrees between the maps where they are covered, which must be the same texels."""
    assert np.array_equal(some[..., 3], every[..., 3])
    return angles.degrees(angles.decode(some), angles.decode(every))[every[..., 3] > 0.0]


@pytest.mark.shared
@pytest.mark.parametrize("size", [512, pytest.param(1024, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("name", "method"),
    [
        pytest.param(name, method, marks=() if name in FAST else pytest.mark.slow)
        for name in PAIRS
        for method in METHODS
        if (name, method) != OTHER_LAYOUT
    ],
)
def test_the_mean_of_adaptive_samples_is_that_of_all(shared_assets, name, method, size):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / f"{name}.blend"))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    reach = 0.02 * max(low.dimensions)
    rays = {"extrusion": reach, "max_distance": 2.0 * reach} if method == "CAST" else {}
    some, every, stopped = both(low, high, method, width=size, height=size, samples=16, **rays)
    error = difference(some, every)
    p99, p999 = np.percentile(error, (99, 99.9))
    print(f"{name} {method} {size}: {stopped:.1%} stopped early; {p99:.4f}, {p999:.4f}, at most {error.max():.2f}")
    assert p99 < ALLOWED_P99
    assert stopped > 0.01  # at 512, texels of the dense terrains hold whole triangles


@pytest.mark.shared
def test_strong_bends_take_as_many_samples_as_are_asked_for(shared_assets):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / "king_40480_4000.blend"))
    some, every, stopped = both(
        bpy.data.objects["lo"], bpy.data.objects["hi"], "FLATTEN", width=256, height=256, samples=64
    )
    assert np.percentile(difference(some, every), 99) < ALLOWED_P99
    assert stopped > 0.1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", COUNTS)
def test_texels_of_a_terrain_stop_early_and_keep_their_mean(method, count):
    low, high = zoo.plane("low"), zoo.terrain("high", n=37, waves=2, height=0.03)
    some, every, stopped = both(low, high, method, width=128, height=128, samples=count)
    error = difference(some, every)
    print(f"{stopped:.1%} stopped early; {np.percentile(error, (99, 99.9, 100))}")
    assert np.percentile(error, 99) < ALLOWED_P99
    assert 0.5 < stopped < 1.0


@pytest.mark.parametrize("gap", [0.97, 0.995])
@pytest.mark.parametrize("method", METHODS)
def test_every_texel_of_which_a_sample_is_covered_stays_covered(method, gap):
    """Thin strips. The first samples of all texels miss the thinner ones."""
    low, high = zoo.two_islands("low", gap=gap), zoo.two_islands("high", gap=gap)
    some, every, _ = both(low, high, method, width=37, height=37, samples=16)
    assert 0 < np.count_nonzero(every[..., 3]) < every[..., 3].size / 4
    assert difference(some, every).max() < 1e-3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
def test_empty_texels_away_from_the_meshes_take_no_more_samples(method, space, monkeypatch):
    low, high = zoo.two_islands("low", gap=0.7), zoo.two_islands("high", gap=0.7)
    listed, find, add = [], active.find, cell_samples.add

    def found(*arguments):
        some = find(*arguments)
        listed.append(some and some.count)
        return some

    def added(sums, records, places, *arguments, **options):
        listed.append(len(places))
        return add(sums, records, places, *arguments, **options)

    monkeypatch.setattr(active, "find", found)
    monkeypatch.setattr(cell_samples, "add", added)
    some, every, stopped = both(low, high, method, width=128, height=128, samples=16, space=space)
    assert difference(some, every).max() < 1e-3
    empty = np.count_nonzero(every[..., 3] == 0.0)
    # Those along the borders of islands are in the same squares of texels.
    assert empty > 128 * 64
    assert 0 < listed[0] < 0.3 * empty
    assert 0.0 < stopped < 1.0


def test_a_texel_of_which_any_ray_hits_is_hit():
    """A high mesh so narrow that it lies between the first two samples of its texels."""
    low, high = zoo.plane("low"), zoo.plane("high")
    high.scale.x, high.location.z = 0.012, 0.1
    some, every, stopped = both(low, high, "CAST", width=31, height=31, samples=64)
    assert 0 < np.count_nonzero(every[..., 3]) <= 3 * 31
    assert difference(some, every).max() < 1e-3
    assert stopped == 0.0


def test_all_samples_are_taken_with_other_maps():
    low, high = zoo.plane("low"), zoo.plane("high")
    settings = Settings("FLATTEN", width=16, height=16, samples=4, maps=("HEIGHT",), storage="MEMORY", material=False)
    assert bake_pair(bpy.context, low, [high], settings).stopped_early == 0.0


@pytest.mark.parametrize(
    ("method", "samples", "are_adaptive"), [("FLATTEN", 16, False), ("FLATTEN", 64, True), ("CAST", 4, True)]
)
def test_samples_are_adaptive_where_that_is_faster(monkeypatch, method, samples, are_adaptive):
    monkeypatch.undo()
    low, high = zoo.plane("low"), zoo.plane("high")
    settings = Settings(method, width=16, height=16, samples=samples, storage="MEMORY", material=False)
    assert (bake_pair(bpy.context, low, [high], settings).stopped_early > 0.0) is are_adaptive


def test_only_texels_that_are_written_count_as_stopped_early():
    """Flatten takes samples wherever the high mesh is. Here the low one has a sixteenth of that."""
    low, high = zoo.plane("low"), zoo.plane("high")
    layer = low.data.uv_layers[0].uv
    layer.foreach_set("vector", np.float32([[0.25, 0.25], [0.5, 0.25], [0.5, 0.5], [0.25, 0.5]]).ravel())
    settings = Settings("FLATTEN", width=64, height=64, samples=64, storage="MEMORY", material=False)
    assert bake_pair(bpy.context, low, [high], settings).stopped_early == 1.0


@pytest.mark.parametrize("method", METHODS)
def test_bands_and_adaptive_samples_together(method, monkeypatch):
    low, high = zoo.plane("low"), zoo.terrain("high", n=23, waves=2, height=0.02)
    whole, _, stopped = both(low, high, method, width=64, height=60, samples=16)
    monkeypatch.setattr(bands, "BAND_TEXELS", 64 * 16)
    banded, every, of_bands = both(low, high, method, width=64, height=60, samples=16)
    assert np.array_equal(whole[..., 3], banded[..., 3])
    assert np.percentile(difference(banded, every), 99) < ALLOWED_P99
    assert 0.0 < of_bands <= stopped  # at the borders of bands, neighbors are not known


def pairs(count):
    """Jobs of planes and rough terrains, whose UVs lie side by side. A single pair's are on tiles 1001 and 1002."""
    jobs = []
    for number in range(count):
        low, high = zoo.plane(f"low {number}"), zoo.terrain(f"high {number}", n=23, waves=5, height=0.05)
        for obj in (low, high):
            layer = obj.data.uv_layers[0].uv
            uv = np.empty((len(layer), 2), np.float32)
            layer.foreach_get("vector", uv.ravel())
            uv = uv * (0.4, 0.8) + (0.5 * number + 0.05, 0.1) if count > 1 else uv * (1.7, 0.9) + (0.15, 0.05)
            layer.foreach_set("vector", uv.astype(np.float32).ravel())
        jobs.append(Job(low, [high]))
    return jobs


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
@pytest.mark.parametrize("layout", ["tiles", "atlas"])
@pytest.mark.parametrize("has_bands", [False, True], ids=["whole", "bands"])
def test_64_samples_by_flatten_are_those_that_are_drawn(layout, has_bands, space, monkeypatch):
    """Where all texels take all samples."""
    monkeypatch.setattr(adaptive_normals, "LIMITS", dict.fromkeys(adaptive_normals.LIMITS, 0.0))
    if has_bands:
        monkeypatch.setattr(bands, "BAND_TEXELS", 64 * 16)
    found = []
    for adaptive in (True, False):
        values = {"space": space, "samples": 64, "adaptive": adaptive, "depth": 32, "material": False}
        if layout == "atlas":
            settings = Settings("FLATTEN", width=64, height=64, image="map", storage="MEMORY", margin=0, **values)
            bake_all(bpy.context, pairs(2), settings, share_image=True)
            found.append([maps.pixels(bpy.data.images["map"])])
        else:
            (job,) = pairs(1)
            tiles = maps.raw_maps(job.low, *job.highs, maps=(), udim=True, **values)
            found.append([tiles[tile][NORMAL.name] for tile in (1001, 1002)])
    for some, every in zip(*found, strict=True):
        assert np.array_equal(some[..., 3], every[..., 3])
        assert np.abs(some - every).max() < 1e-3
        assert 0.3 < (every[..., 3] > 0.0).mean() < 1.0
        assert len(np.unique(every)) > 1000


@pytest.mark.parametrize("count", COUNTS)
def test_rounds_are_all_samples_in_opposite_pairs(count):
    found = samples.rounds(count)
    assert sorted(sum(found, [])) == sorted(samples.offsets(count))
    assert [sum(map(len, found[:stop])) for stop in range(1, len(found) + 1)] == [
        stop for stop in (2, 4, 8, 16, 64) if stop <= count and (stop, count) != (4, 8)
    ]
    for offsets in found:
        assert np.allclose(np.array(offsets[::2]) + np.array(offsets[1::2]), 0.0)


def drawn_rounds(first, second, limits, offset=(0.25, 0.0)):
    """The rounds of a map whose first two samples are these normals (H, W, 4)."""
    one, other = (
        gpu.types.GPUTexture(
            values.shape[1::-1], format="RGBA32F", data=gpu.types.Buffer("FLOAT", values.shape, values)
        )
        for values in (first, second)
    )
    into = target.Target(first.shape[1], first.shape[0], rounds.FORMATS)
    return rounds.draw(into, one, other, offset=offset, limits=limits)


def leaning(degrees):
    """Unit normals with alpha 1 that lean along x."""
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), 0.0 * angle, np.cos(angle), 0.0 * angle + 1.0], axis=-1).astype(np.float32)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("bend", "expected"), [(0.5, 1), (1.5, 2), (2.5, 3), (3.5, 4), (4.5, 5)])
def test_a_bend_in_a_row_or_a_column_decides_how_many_rounds_a_texel_takes(axis, bend, expected):
    slopes = 0.5 * np.arange(9.0) + bend * np.maximum(np.arange(9.0) - 4.0, 0.0)
    values = leaning(np.tile(slopes, (9, 1)) if axis else np.tile(slopes[:, None], (1, 9)))
    towards = np.roll(values, -1, axis=axis) - np.roll(values, 1, axis=axis)
    needed = drawn_rounds(
        values + 0.1 * towards, values - 0.1 * towards, (1.0, 2.0, 3.0, 4.0), (0.2, 0.0)[:: 1 if axis else -1]
    )
    inner = needed[1:-1, 1:-1] if axis else needed[1:-1, 1:-1].T
    assert (inner[:, 3] == expected).all()
    assert (np.delete(inner, 3, axis=1) == 1).all()
    assert (needed[[0, -1]] == 5).all() and (needed[:, [0, -1]] == 5).all()  # the border of the map


def test_an_edge_between_the_first_samples_is_found_although_the_means_are_in_line():
    left, right = leaning(np.full((5, 5), -30.0)), leaning(np.full((5, 5), 30.0))
    first, second = left.copy(), left.copy()
    first[:, 2], first[:, 3:], second[:, 3:] = right[:, 2], right[:, 3:], right[:, 3:]
    needed = drawn_rounds(first, second, (0.2, 0.5, 1.0))
    assert (needed[1:-1, 2] == 4).all()


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("size", [(8, 8), (21, 13), (64, 40)])
def test_random_texels_are_listed_once_each(seed, size):
    height, width = size
    random = np.random.default_rng(seed)
    needed = random.integers(1, 4, size).astype(np.uint8)
    texture = target.Target(width, height, ("R8",)).texture
    some = active.find(texture, needed, 2)
    listed, blocks = active.in_blocks(needed >= 2)
    assert some.count == len(listed) == np.count_nonzero(needed >= 2)
    assert some.rows // 8 * -(-width // 8) * 64 >= some.count
    assert {tuple(place) for place in listed.tolist()} == {(x, y) for y, x in np.argwhere(needed >= 2).tolist()}
    assert {tuple(place) for place in (listed // active.BLOCK).tolist()} == {(x, y) for y, x in np.argwhere(blocks)}
    assert active.find(texture, needed, 4) is None
