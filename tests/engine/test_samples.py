# SPDX-License-Identifier: GPL-3.0-or-later
"""Antialiasing: the mean of several samples per texel, with both methods."""

import bpy
import gpu
import numpy as np
import pytest

from addon.core.declarations.all_settings import DECLARED
from addon.core.declarations.map_settings import MAP
from addon.core.map_types import NORMAL
from addon.core.settings import Settings
from addon.engine import bands
from addon.jobs import bake_pair
from addon.passes import samples, target
from tests.support import angles, lanes, layouts, maps, scenes, zoo
from tests.support.layouts import Layout
from tests.support.maps import bake, bake_all_maps, texel_uv
from tests.support.real_meshes import FAST, PAIRS, open_pair

pytestmark = pytest.mark.usefixtures("gpu_context")


METHODS = ["FLATTEN", "CAST"]
RAYS = {"extrusion": 1.5, "max_distance": 3.0}
AREA_MEAN = 2.0
"""Degrees between a border texel of 16 samples and the mean by area. A sample more or less on one side is one sixteenth."""


@pytest.mark.parametrize("count", DECLARED["samples"].values)
def test_samples_are_spread_evenly_around_the_center(count):
    x, y = np.array(samples.offsets(count)).T
    assert np.allclose([x.mean(), y.mean()], 0.0)
    if count in (4, 16, 64):
        assert np.isclose((x * y).mean(), 0.0)  # no diagonal is preferred
    for values in (x, y):  # one in each row and column
        assert np.array_equal(np.sort(np.floor((values + 0.5) * count)), np.arange(count))


def step(slope, at):
    """A roof with its ridge along v at u = `at`, and the plane below it."""
    x = 2.0 * at - 1.0
    points = [(-1, -1, -slope * (x + 1)), (x, -1, 0), (1, -1, -slope * (1 - x))]
    points += [(px, 1, z) for px, _, z in points]
    faces, uv = [(0, 1, 4, 3), (1, 2, 5, 4)], [((px + 1) / 2, (py + 1) / 2) for px, py, _ in points]
    high = zoo.build("high", points, faces, np.array(uv)[np.array(faces)], smooth=False)
    return zoo.plane("low"), high


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("share", [0.25, 0.5, 0.8])
def test_the_rim_between_two_facets_is_their_mean_by_area(method, share):
    size, column = 16, 7
    low, high = step(0.6, (column + share) / size)
    left, right = np.array((-0.6, 0, 1)) / np.hypot(0.6, 1), np.array((0.6, 0, 1)) / np.hypot(0.6, 1)
    rays = RAYS if method == "CAST" else {}
    single = angles.decode(bake(low, high, method=method, size=(size, size), image="one", **rays))[:, column]
    many = angles.decode(bake(low, high, method=method, size=(size, size), samples=16, image="many", **rays))
    mean = share * left + (1 - share) * right
    assert angles.degrees(many[:, column], mean / np.linalg.norm(mean)).max() < AREA_MEAN
    # With one sample it is one of the two. On the ridge itself it may be either.
    assert np.minimum(angles.degrees(single, left), angles.degrees(single, right)).max() < 0.1
    assert angles.degrees(many[:, column - 1], left).max() < 0.1
    assert angles.degrees(many[:, column + 1], right).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_the_error_of_a_sine_terrain_falls_with_every_doubling(method):
    """Compared with the mean of the true normals over each texel's area, at 32 x 32 points."""
    size, waves, height, fine = 32, 6, 0.04, 32
    u, v = np.moveaxis(texel_uv(size * fine, size * fine), -1, 0)
    step_ = 2 * np.pi * waves
    dx, dy = (0.5 * step_ * height * a(step_ * u) * b(step_ * v) for a, b in ((np.cos, np.sin), (np.sin, np.cos)))
    expected = np.stack([-dx, -dy, np.ones_like(dx)], axis=-1)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    expected = expected.reshape(size, fine, size, fine, 3).mean(axis=(1, 3))
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    low, high = zoo.plane("low"), zoo.terrain("high", n=640, waves=waves, height=height)
    rays = {"extrusion": 0.3, "max_distance": 0.6} if method == "CAST" else {}
    inner = angles.eroded(np.ones((size, size), bool), 1)
    errors = []
    for count in (1, 2, 4, 8, 16):
        texels = bake(low, high, method=method, size=(size, size), samples=count, **rays)
        errors.append(angles.degrees(angles.decode(texels), expected)[inner].mean())
    print(method, [round(error, 4) for error in errors])
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < errors[0] / 10


@pytest.mark.slow
def test_the_error_falls_over_256_texels():
    """A strip of the same terrain with as many waves per texel: 48 waves over 256 x 16 texels."""
    (width, height), (along, across), quads, fine = (256, 16), (48, 3), 106, 16
    angle = 2 * np.pi

    def surface(u, v):
        return np.stack([along * u, across * v, 0.15 * np.sin(angle * along * u) * np.sin(angle * across * v)], axis=1)

    expected = np.zeros((height, width, 3))
    for du, dv in np.ndindex(fine, fine):
        x, y = np.meshgrid(np.arange(width) + (du + 0.5) / fine, np.arange(height) + (dv + 0.5) / fine)
        x, y = angle * along * x / width, angle * across * y / height
        slopes = 0.15 * angle * np.cos(x) * np.sin(y), 0.15 * angle * np.sin(x) * np.cos(y)
        normals = np.stack([-slopes[0], -slopes[1], np.ones_like(x)], axis=-1)
        expected += normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    high = zoo.sheet("high", surface, along * quads, across * quads)
    low = zoo.sheet("low", lambda u, v: np.stack([along * u, across * v, 0 * u], axis=1), 1, 1)
    inner = angles.eroded(np.ones((height, width), bool), 1)
    errors = []
    for count in (1, 2, 4, 8, 16):
        texels = bake(low, high, size=(width, height), samples=count)
        errors.append(angles.degrees(angles.decode(texels), expected)[inner].mean())
    print([round(error, 4) for error in errors])
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize("method", METHODS)
def test_only_covered_samples_count(method):
    """At the border of an island, the result is the normalized mean of the samples on the island."""
    low, high = zoo.two_islands("low", gap=0.33), zoo.two_islands("high", gap=0.33)
    rays = RAYS if method == "CAST" else {}
    texels = bake(low, high, method=method, size=(33, 33), samples=16, space="OBJECT", **rays)
    covered = texels[..., 3] > 0
    single = bake(low, high, method=method, size=(33, 33), space="OBJECT", image="single", **rays)[..., 3] > 0
    assert np.abs(texels[covered] - np.float32((0.5, 0.5, 1.0, 1.0))).max() < 1e-6
    assert covered.sum() > single.sum()  # a texel is covered where any sample is
    assert covered[single].all()


def test_a_texel_is_missed_when_none_of_its_rays_hits():
    low, high = zoo.plane("low"), zoo.plane("high")
    high.scale.x = 0.53
    options = {"method": "CAST", "size": (32, 32), "missed": (1.0, 0.0, 0.0), **RAYS}
    single, many = bake(low, high, **options), bake(low, high, samples=16, image="many", **options)
    holes = many[..., 3] == 0.0
    assert (many[holes] == np.float32((1, 0, 0, 0))).all()
    assert holes.sum() <= (single[..., 3] == 0.0).sum()
    assert np.abs(many[~holes] - np.float32((0.5, 0.5, 1, 1))).max() < 1e-6


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_tangents_change_neither_hits_nor_misses(samples):
    """A small island of many faces. Its borders lie beside the centers of texels; one of them hits nothing."""
    low, high = zoo.plane("low", n=9), zoo.plane("high")
    layer = low.data.uv_layers[0].uv
    uv = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", uv.ravel())
    layer.foreach_set("vector", (uv * np.float32((0.27, 0.43)) + np.float32((0.05, 0.51))).ravel())
    high.scale.x, high.location.x = 0.5, 0.6
    tangent, other = (
        maps.raw_maps(low, high, maps=(), size=33, method="CAST", samples=samples, space=space, **RAYS)[1001][
            NORMAL.name
        ]
        for space in ("TANGENT", "OBJECT")
    )
    assert np.array_equal(tangent[..., 3], other[..., 3])
    assert set(np.unique(tangent[..., 3])) == {-1.0, 0.0, 1.0}


def test_bands_and_samples_together(monkeypatch):
    from addon.engine import bands

    low, high = zoo.sphere("low", n=8), zoo.sphere("high", n=32)
    whole = bake(low, high, samples=4, size=(64, 60), image="whole")
    monkeypatch.setattr(bands, "BAND_TEXELS", 64 * 16)
    banded = bake(low, high, samples=4, size=(64, 60), image="banded")
    assert np.array_equal(whole[..., 3], banded[..., 3])
    assert angles.degrees(angles.decode(whole), angles.decode(banded)).max() < 0.03


@pytest.mark.parametrize("samples", [1, 16, 64])
def test_texels_that_all_samples_miss_are_missed_in_every_map(samples):
    low, high = zoo.plane("low"), zoo.plane("high")
    high.scale.x, high.location.z = 0.5, 0.1
    settings = Settings(
        method="CAST",
        width=32,
        height=16,
        samples=samples,
        extrusion=0.2,
        max_distance=0.4,
        maps=("HEIGHT", "POSITION", "DISTANCE", "DISPLACEMENT"),
        image="map",
        storage="MEMORY",
        depth=32,
        margin=0,
        material=False,
    )
    report = bake_pair(bpy.context, low, [high], settings)
    for name in ["map", *(found["image"] for found in report.maps.values())]:
        alpha = maps.pixels(bpy.data.images[name])[..., 3]
        assert (alpha[:, 8:24] == 1.0).all(), name
        assert (alpha[:, :8] == 0.0).all() and (alpha[:, 24:] == 0.0).all(), name


# Partial texels


SIZE = 48
LOW = Layout(degrees=24.0, scale=0.34)
MAPS = ("AO", "THICKNESS", "CURVATURE", "BENT_NORMAL", "ROUGHNESS", "HEIGHT")


@pytest.mark.parametrize(("space", "has_detail"), [("TANGENT", True), ("WORLD", False)])
@pytest.mark.parametrize(("method", "samples", "rays"), [("FLATTEN", 4, 16), ("FLATTEN", 16, 17), ("CAST", 16, 17)])
def test_borders_are_means_of_the_samples_on_the_mesh(method, samples, rays, space, has_detail):
    """On a flat high mesh that reaches beyond the low one, each map has one value, also at its border."""
    low = layouts.square("lo", {zoo.LAYER: LOW})
    wide = Layout(LOW.degrees, scale=1.4 * LOW.scale)
    high = layouts.square("hi", {zoo.LAYER: wide})
    high.scale = (1.4, 1.4, 1.0)
    material = scenes.material("skin", Roughness=0.3)
    high.data.materials.append(material)
    if has_detail:
        node = material.node_tree.nodes.new("ShaderNodeNormalMap")
        flat = scenes.image("flat", np.full((4, 4, 3), (0.5, 0.5, 1.0)), space="Non-Color", is_float=True)
        material.node_tree.links.new(scenes.texture(material, flat).outputs[0], node.inputs["Color"])
        scenes.set_inputs(material, Normal=node.outputs[0])
    _, maps = bake_all_maps(low, high, maps=MAPS, size=SIZE, method=method, samples=samples, rays=rays, space=space)
    known = maps["height"][..., 3] == 1.0
    expected = {"ao": 1.0, "thickness": 1.0, "curvature": 0.5, "roughness": 0.3, "height": 0.0}
    assert known.mean() > 0.4
    for name, value in expected.items():
        found = maps[name]
        if space == "TANGENT" or method == "CAST":
            assert np.array_equal(found[..., 3] == 1.0, known), name
        assert np.abs(found[known, 0] - value).max() < 1e-3, (name, found[known, 0].min(), found[known, 0].max())
    whole = angles.eroded(known, 1)
    assert np.abs(maps["bent_normal"][whole, 2] - 1.0).max() < 0.02
    assert np.abs(np.linalg.norm(maps["bent_normal"][known, :3] * 2.0 - 1.0, axis=-1) - 1.0).max() < 1e-5


# Adaptive samples


ADAPTIVE_RAYS = {"extrusion": 0.3, "max_distance": 0.6}
ALLOWED_P99 = 0.02
"""Degrees between the mean of adaptive samples and that of all samples."""


def both(low, high, **settings):
    """The maps with adaptive samples and with all samples, and the share that stopped early."""
    values = {
        "method": "CAST",
        "margin": 0,
        "depth": 32,
        "storage": "MEMORY",
        "material": False,
        **ADAPTIVE_RAYS,
        **settings,
    }
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


SIZES = lanes.in_turn(FAST, PAIRS, [512, 1024])


@pytest.mark.shared
@pytest.mark.parametrize("case", lanes.slow_but([(FAST[0], 512)], SIZES), ids=str)
def test_the_mean_of_adaptive_samples_is_that_of_all(shared_assets, case):
    name, size = case
    low, high = open_pair(shared_assets, name)
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
    low, high = open_pair(shared_assets, "king_40480_4000")
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
    assert {tuple(place) for place in (listed // samples.GROUP_SIDE).tolist()} == {
        (x, y) for y, x in np.argwhere(blocks)
    }
    assert samples.find_active(texture, needed, 4) is None
