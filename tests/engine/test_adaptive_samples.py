# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests adaptive samples: against all samples in every texel, and how many samples texels take."""

import bpy
import gpu
import numpy as np
import pytest

from addon.core.declarations.map_settings import MAP
from addon.core.settings import Settings
from addon.engine import bands
from addon.jobs import bake_pair
from addon.passes import samples, target
from tests.support import angles, maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

RAYS = {"extrusion": 0.3, "max_distance": 0.6}
ALLOWED_P99 = 0.02
"""Degrees between the mean of adaptive samples and that of all samples."""
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
FAST = ["spot_1696_536"]


def both(low, high, **settings):
    """The maps with adaptive samples and with all samples, and the share that stopped early."""
    values = {"method": "CAST", "margin": 0, "depth": 32, "storage": "MEMORY", "material": False, **RAYS, **settings}
    found, stopped = [], []
    for is_adaptive in (True, False):
        report = bake_pair(bpy.context, low, [high], Settings(image="map", adaptive=is_adaptive, **values))
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
@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name in FAST else pytest.mark.slow) for name in PAIRS])
def test_the_mean_of_adaptive_samples_is_that_of_all(shared_assets, name, size):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / f"{name}.blend"))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    reach = 0.02 * max(low.dimensions)
    rays = {"extrusion": reach, "max_distance": 2.0 * reach}
    some, every, stopped = both(low, high, width=size, height=size, samples=16, **rays)
    error = difference(some, every)
    p99, p999 = np.percentile(error, (99, 99.9))
    print(f"{name} {size}: {stopped:.1%} stopped early; {p99:.4f}, {p999:.4f}, at most {error.max():.2f}")
    assert p99 < ALLOWED_P99
    assert stopped > 0.01  # at 512, texels of the dense terrains hold whole triangles


@pytest.mark.slow
@pytest.mark.shared
def test_strong_bends_take_as_many_samples_as_are_asked_for(shared_assets):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / "king_40480_4000.blend"))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    reach = 0.02 * max(low.dimensions)
    rays = {"extrusion": reach, "max_distance": 2.0 * reach}
    some, every, stopped = both(low, high, width=256, height=256, samples=64, **rays)
    assert np.percentile(difference(some, every), 99) < ALLOWED_P99
    assert stopped > 0.1


@pytest.mark.parametrize("count", [4, 16])
def test_texels_of_a_terrain_stop_early_and_keep_their_mean(count):
    low, high = zoo.plane("low"), zoo.terrain("high", n=37, waves=2, height=0.03)
    some, every, stopped = both(low, high, width=128, height=128, samples=count)
    error = difference(some, every)
    print(f"{stopped:.1%} stopped early; {np.percentile(error, (99, 99.9, 100))}")
    assert np.percentile(error, 99) < ALLOWED_P99
    assert 0.5 < stopped < 1.0


@pytest.mark.parametrize("gap", [0.97, 0.995])
def test_every_texel_of_which_a_sample_is_covered_stays_covered(gap):
    """Thin strips. The first samples of all texels miss the thinner ones."""
    low, high = zoo.two_islands("low", gap=gap), zoo.two_islands("high", gap=gap)
    some, every, _ = both(low, high, width=37, height=37, samples=16)
    assert 0 < np.count_nonzero(every[..., 3]) < every[..., 3].size / 4
    assert difference(some, every).max() < 1e-3


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
def test_empty_texels_away_from_the_meshes_take_no_more_samples(space, monkeypatch):
    low, high = zoo.two_islands("low", gap=0.7), zoo.two_islands("high", gap=0.7)
    listed, find = [], samples.find_active

    def found(*arguments):
        some = find(*arguments)
        listed.append(some and some.count)
        return some

    monkeypatch.setattr(samples, "find_active", found)
    some, every, stopped = both(low, high, width=128, height=128, samples=16, space=space)
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
    some, every, stopped = both(low, high, width=31, height=31, samples=64)
    assert 0 < np.count_nonzero(every[..., 3]) <= 3 * 31
    assert difference(some, every).max() < 1e-3
    assert stopped == 0.0


@pytest.mark.parametrize(
    ("values", "are_adaptive"),
    [
        ({"method": "CAST", "samples": 4}, True),
        ({"method": "CAST", "samples": 2}, False),
        ({"method": "CAST", "samples": 4, "maps": ("HEIGHT",)}, False),
        ({"method": "FLATTEN", "samples": 64}, False),
    ],
)
def test_samples_are_adaptive_where_that_is_faster(values, are_adaptive):
    low, high = zoo.plane("low"), zoo.plane("high")
    settings = Settings(width=16, height=16, storage="MEMORY", material=False, **values)
    assert (bake_pair(bpy.context, low, [high], settings).stopped_early > 0.0) is are_adaptive


def test_only_texels_that_are_written_count_as_stopped_early():
    """The low mesh has a part of the map."""
    low, high = zoo.plane("low"), zoo.plane("high")
    layer = low.data.uv_layers[0].uv
    layer.foreach_set("vector", np.float32([[0.25, 0.25], [0.5, 0.25], [0.5, 0.5], [0.25, 0.5]]).ravel())
    settings = Settings(method="CAST", width=64, height=64, samples=64, storage="MEMORY", material=False)
    stopped = bake_pair(bpy.context, low, [high], settings).stopped_early
    assert stopped == (14 / 16) ** 2  # all but those at the border


def test_bands_and_adaptive_samples_together(monkeypatch):
    low, high = zoo.plane("low"), zoo.terrain("high", n=23, waves=2, height=0.02)
    whole, _, stopped = both(low, high, width=64, height=60, samples=16)
    monkeypatch.setattr(bands, "BAND_TEXELS", 64 * 16)
    banded, every, of_bands = both(low, high, width=64, height=60, samples=16)
    assert np.array_equal(whole[..., 3], banded[..., 3])
    assert np.percentile(difference(banded, every), 99) < ALLOWED_P99
    assert 0.0 < of_bands <= stopped  # at the borders of bands, neighbors are not known


@pytest.mark.parametrize("count", [count for count in MAP["samples"].values if count > 2])
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
    into = target.Target(first.shape[1], first.shape[0], samples.ROUND_FORMATS)
    return samples.draw_rounds(into, one, other, offset=offset, limits=limits)


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
    some = samples.find_active(texture, needed, 2)
    listed, blocks = samples.in_blocks(needed >= 2)
    assert some.count == len(listed) == np.count_nonzero(needed >= 2)
    assert some.rows // 8 * -(-width // 8) * 64 >= some.count
    assert {tuple(place) for place in listed.tolist()} == {(x, y) for y, x in np.argwhere(needed >= 2).tolist()}
    assert {tuple(place) for place in (listed // samples.BLOCK).tolist()} == {(x, y) for y, x in np.argwhere(blocks)}
    assert samples.find_active(texture, needed, 4) is None
