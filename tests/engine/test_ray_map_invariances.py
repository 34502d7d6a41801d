# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps whose rays start at the hits stay the same however they are drawn, and wherever the objects are."""

import mathutils
import numpy as np
import pytest

from addon.engine import bands
from tests.support import angles, lanes, layouts, zoo
from tests.support.maps import bake_all_maps, raw_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
MAPS = ("AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "CONVEXITY", "CAVITY")
HALVES = ("convexity", "cavity")
SCALARS = ("ao", "thickness", "curvature", *HALVES)
SAME, OTHER, FEW = "the same rays", "other rays", "few rays"
RMS = {SAME: 0.25 / 255, OTHER: 3.6 / 255, FEW: 6.0 / 255}
"""The largest root mean square difference of ambient occlusion, thickness and curvature.

The same rays start at points that differ in the last bits; a few pass an edge on the other side. Of other rays, 128 a texel,
both maps have an error of 2.5/255. Few rays are 64 a texel."""
MEAN = 0.5 / 255
BENT = {SAME: 0.3, OTHER: 3.0, FEW: 5.0}
"""Degrees at the 95th percentile."""


def pair(n=47):
    """A plane and a terrain with the same UVs; rays from the plane go straight up."""
    return zoo.plane("lo", 2), zoo.terrain("hi", n, height=0.12, waves=3)


def bake(low, *highs, maps=MAPS, **settings):
    return bake_all_maps(
        low, *highs, maps=maps, size=SIZE, **{"curvature_radius": 0.05, "thickness_distance": 0.2} | settings
    )[1]


def compare(found, expected, rays=OTHER, *, where=slice(None)):
    """Compare maps by name in lower case. Convexity and cavity have twice the scale of the curvature."""
    for name in SCALARS:
        mine, other = (maps[name][where] for maps in (found, expected))
        assert np.array_equal(mine[..., 3], other[..., 3])
        difference = (mine - other)[..., 0].astype(np.float64)
        rms = np.sqrt((difference**2).mean())
        print(
            f"{name}: spread {other[..., 0].std():.4f}, mean {difference.mean() * 255:+.3f}/255, RMS {rms * 255:.3f}/255"
        )
        assert abs(difference.mean()) < MEAN
        assert rms < RMS[rays] * (2.0 if name in HALVES else 1.0)
        assert other[..., 0].std() > 4.0 / 255  # otherwise the map shows nothing
    degrees = angles.degrees(*(angles.decode(maps["bent_normal"][where]) for maps in (found, expected)))
    print(f"bent: 95th percentile {np.percentile(degrees, 95):.3f}")
    assert np.percentile(degrees, 95) < BENT[rays]


@pytest.mark.parametrize("samples", lanes.slow_but([4], [1, 4]))
def test_flatten_equals_cast_on_shared_uvs(samples):
    on_edges = np.eye(SIZE, dtype=bool)  # the texels in the diagonals of quads; either triangle is right
    flat, cast = bake(*pair(), samples=samples), bake(*pair(), samples=samples, method="CAST")
    compare(flat, cast, SAME, where=~(on_edges | on_edges[::-1]))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "samples"), [("FLATTEN", 16), ("CAST", 4)])
def test_more_samples_only_average(method, samples):
    """On a fine surface: within a texel, the curvature of facets varies."""
    compare(bake(*pair(150), method=method, samples=samples), bake(*pair(150), method=method))


@pytest.mark.slow
def test_more_samples_than_rays_cast_one_each():
    compare(bake(*pair(), samples=64, rays=16), bake(*pair(), samples=4), FEW)


@pytest.mark.parametrize(
    ("method", "samples", "space"),
    [("FLATTEN", 1, "WORLD"), ("FLATTEN", 16, "TANGENT"), ("CAST", 4, "TANGENT"), ("CAST", 16, "WORLD")],
)
def test_all_maps_cover_the_same_texels(method, samples, space):
    """Also at borders, where the low mesh covers samples but not the center of the texel."""
    layout = layouts.Layout(degrees=24.0, scale=0.34)
    low, high = (layouts.square(name, {zoo.LAYER: layout}) for name in ("lo", "hi"))
    maps = raw_maps(low, high, maps=MAPS, method=method, samples=samples, space=space, rays=16)[1001]
    for name in MAPS:
        assert np.array_equal(maps[name][..., 3], maps["NORMAL"][..., 3]), name


@pytest.mark.parametrize("method", lanes.slow_but(["CAST"], ["FLATTEN", "CAST"]))
def test_bands_have_no_seams(method, monkeypatch):
    whole = bake(*pair(), method=method, margin=5)
    monkeypatch.setattr(bands, "BAND_TEXELS", 24 * SIZE)
    parts = bake(*pair(), method=method, margin=5)
    compare(parts, whole)
    for name in SCALARS:
        for row in (24, 48):
            steps = [np.diff(maps[name][..., 0], axis=0)[row - 1].mean() for maps in (parts, whole)]
            assert abs(steps[0] - steps[1]) < 2.0 / 255, name


@pytest.mark.slow
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_tiles_have_no_seams(method):
    """Nothing is scaled a tile: the two halves of a surface on two tiles are those of one map twice as wide."""
    whole = bake_all_maps(*wide_pair(0.5), maps=MAPS, size=(2 * SIZE, SIZE), method=method, **RADII)[1]
    tiles = raw_maps(*wide_pair(1.0), maps=MAPS, size=SIZE, method=method, udim=True, storage="PACK", **RADII)
    both = {name.lower(): np.concatenate([tiles[tile][name] for tile in (1001, 1002)], axis=1) for name in MAPS}
    both["bent_normal"][..., :3] = both["bent_normal"][..., :3] * 0.5 + 0.5
    compare(both, whole, where=(slice(1, -1), slice(1, -1)))


RADII = {"curvature_radius": 0.05, "thickness_distance": 0.2}


def wide_pair(width):
    """The pair with u scaled, so that it fills a part of a tile, or two tiles."""
    objects = pair()
    for obj in objects:
        uv = obj.data.uv_layers[0].uv
        uv.foreach_set("vector", [part.vector[axis] * (2.0 * width, 1.0)[axis] for part in uv for axis in range(2)])
    return objects


def matrix(case):
    turn = mathutils.Matrix.Rotation(0.8, 4, (0.5, -0.3, 0.7))
    return {
        "turned and tiny": turn @ mathutils.Matrix.Scale(1e-4, 4),
        "far": mathutils.Matrix.Translation((1e5, -2e5, 3e5)),
        "turned and mirrored": turn @ mathutils.Matrix.Diagonal((-1.0, 1.0, 1.0, 1.0)),
    }[case]


@pytest.mark.parametrize("method", lanes.slow_but(["CAST"], ["FLATTEN", "CAST"]))
def test_objects_may_be_anywhere(method):
    """Distances are shares of the diagonal of the bounding box, which a turn changes: they are set in scene units."""
    low, high = pair()
    diagonal = 2.0 * np.sqrt(2.0)

    def settings(scale):
        return {
            "method": method,
            "distance_unit": "SCENE",
            "ao_distance": 0.5 * diagonal * scale,
            "curvature_radius": 0.05 * diagonal * scale,
            "thickness_distance": 0.2 * diagonal * scale,
        }

    still = bake(low, high, **settings(1.0))
    for case in ("turned and tiny", "far", "turned and mirrored"):
        placed = matrix(case)
        for obj in (low, high):
            obj.matrix_world = placed
        moved = bake(low, high, **settings(abs(placed.determinant()) ** (1.0 / 3.0)))
        if case == "turned and mirrored":  # the tangent space is mirrored as well
            assert np.abs(moved["bent_normal"] - still["bent_normal"]).mean() < 0.02
        compare(moved, still)
