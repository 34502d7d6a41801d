# SPDX-License-Identifier: GPL-3.0-or-later
"""Antialiasing: the mean of several samples per texel, with both methods."""

import bpy
import numpy as np
import pytest

from addon.core.declarations.all_settings import DECLARED
from addon.core.map_types import NORMAL
from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.passes import samples
from tests.support import angles, maps, zoo
from tests.support.maps import bake, texel_uv

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
