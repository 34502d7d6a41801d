# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the rules that choose a hit against a float64 oracle that tests every triangle."""

import re
from dataclasses import replace

import gpu
import numpy as np
import pytest

from addon.core.declarations.choices import Hit
from addon.mesh import bvh, edges
from addon.passes import cast, shader, target
from tests.support import angles, oracle, owner_oracle

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 24
START, INSIDE = 0.5, 0.4
NUDGE = 3e-6
"""In the units of the positions, some ten times the rounding of single precision. A texel counts if moving its ray by so much
changes nothing, whichever of the low triangles that hold a closest point counts: those cases may be decided either way."""
STEADY = 0.9
"""Share of the texels that count, so that the comparison is about most of them."""
HEIGHT = 2e-5
"""In the units of the positions: heights of the same hit in single and in double precision."""
NORMAL_P99 = 0.02
"""Degrees."""
CANDIDATES = int(re.search(r"CAST_CANDIDATES = (\d+)", shader.source("bake/cast_comp.glsl"))[1])


def trace(rays, high, normals, low, across, *, rule=Hit.OWN, facing_only=False, room=1e8, by_order=False):
    """Heights (N,), whether there is a hit, is not owned, is from behind (N,) bool, and the unit normals (N, 3)."""
    high_tree, low_tree = (bvh.build(c.reshape(-1, 3), np.arange(c.size // 3).reshape(-1, 3)) for c in (high, low))
    numbers = np.arange(high.size // 3).reshape(-1, 3)[high_tree.order]
    tables = cast.upload(
        high_tree,
        high.reshape(-1, 3),
        numbers,
        normals.reshape(-1, 3),
        np.zeros(len(numbers), int),
    )
    place = np.empty(len(low), int)
    place[low_tree.order] = np.arange(len(low))
    moved = np.where(across >= 0, place[across], -1)[low_tree.order]
    uploaded = cast.upload_owners(
        low_tree,
        low[low_tree.order],
        moved,
        room=room,
    )
    drawn = target.Target(SIZE, SIZE, ("RGBA32F", "RGBA32F"))
    for slot, (values, alpha) in enumerate(((rays.places, place[rays.own] + 1), (rays.away, rays.start))):
        texels = np.empty((SIZE * SIZE, 4), np.float32)
        texels[:, :3], texels[:, 3] = values, alpha
        drawn.textures[slot] = gpu.types.GPUTexture(
            (SIZE, SIZE), format="RGBA32F", data=gpu.types.Buffer("FLOAT", texels.shape, texels)
        )
    hits, found = target.Target(SIZE, SIZE, ("RGBA32UI",)), target.Target(SIZE, SIZE, ("RGBA32F",))
    search = cast.Search(rule, rays.inside, 1e8, facing_only, by_order)
    cast.trace(hits, drawn, tables, uploaded, search, rows=range(SIZE))
    heights, looked_up = (np.empty((SIZE, SIZE, 4), np.float32) for _ in range(2))
    cast.heights(found, hits, drawn)
    found.read(heights)
    cast.look_up(found, hits, drawn, tables, np.eye(3))
    found.read(looked_up)
    height, is_not_owned, is_from_behind, alpha = heights.reshape(-1, 4).T
    return height, alpha > 0.0, is_not_owned > 0.0, is_from_behind > 0.0, looked_up.reshape(-1, 4)[:, :3]


def rays_from(rng, low, turn):
    """Rays from random places on random triangles, along the face's normal, turned at random by about `turn` radians."""
    own = rng.integers(0, len(low), SIZE * SIZE)
    weights = rng.dirichlet((1.0, 1.0, 1.0), SIZE * SIZE)
    places = np.einsum("nk,nkc->nc", weights, low[own].astype(np.float64)).astype(np.float32)
    face = np.cross(low[own, 1] - low[own, 0], low[own, 2] - low[own, 0])
    away = face / np.linalg.norm(face, axis=1, keepdims=True) + turn * rng.normal(size=face.shape)
    away = (away / np.linalg.norm(away, axis=1, keepdims=True)).astype(np.float32)
    return owner_oracle.Rays(places, away, own, START, INSIDE)


def in_double(rays):
    return replace(rays, places=rays.places.astype(np.float64), away=rays.away.astype(np.float64))


def same(a, b, tolerance):
    """Which texels (N,) bool have the same outcome: a hit or a miss, its height and its flags."""
    return (
        ((a.triangle < 0) == (b.triangle < 0))
        & (a.is_not_owned == b.is_not_owned)
        & (a.is_from_behind == b.is_from_behind)
        & (np.abs(a.height - b.height) < tolerance)
    )


def check(rng, rays, high, normals, low, *, expect, rule=Hit.OWN, facing_only=False, by_order=False):
    """Compare with the oracle where it is steady. expect: the least share of rays by outcome."""
    high, normals, low = (np.ascontiguousarray(values, np.float32) for values in (high, normals, low))
    across = edges.neighbors(low.reshape(-1, 3), np.arange(low.size // 3).reshape(-1, 3))

    def truth_of(rays, tie=None):
        if rule == Hit.NEAREST:
            return owner_oracle.nearest_hits(rays, high, facing_only=facing_only)
        return owner_oracle.own_hits(
            rays,
            high,
            normals.astype(np.float64),
            low,
            across,
            most=CANDIDATES + 1,
            facing_only=facing_only,
            tie=tie,
            by_order=by_order,
        )

    double = in_double(rays)
    truth, is_steady = truth_of(double), np.ones(SIZE * SIZE, bool)
    for tie in (0, 1, -1):
        places, away = (v + NUDGE * rng.normal(size=v.shape) for v in (double.places, double.away))
        is_steady &= same(truth, truth_of(replace(double, places=places, away=away), tie), 1e-3)
    height, is_hit, is_not_owned, is_from_behind, found = trace(
        rays, high, normals, low, across, rule=rule, facing_only=facing_only, by_order=by_order
    )
    ours = owner_oracle.Chosen(np.where(is_hit, 0, -1), height, truth.weights, is_not_owned, is_from_behind)
    is_same = same(truth, ours, HEIGHT)
    outcomes = {
        "own": (truth.triangle >= 0) & ~truth.is_not_owned & ~truth.is_from_behind,
        "not owned": truth.is_not_owned,
        "from behind": truth.is_from_behind,
        "missed": truth.triangle < 0,
    }
    shares = {name: float(each[is_steady].mean()) for name, each in outcomes.items()}
    wrong = np.flatnonzero(is_steady & ~is_same)
    print(f"{shares}, steady {is_steady.mean():.2%}, {len(wrong)} differ: {wrong[:8]}")
    assert is_steady.mean() >= STEADY
    for name, share in expect.items():
        assert shares[name] >= share, (name, shares)
    assert len(wrong) == 0, [(truth.height[i], height[i], truth.is_not_owned[i], is_not_owned[i]) for i in wrong[:8]]
    compared = is_steady & (truth.triangle >= 0)
    expected = np.einsum("nk,nkc->nc", truth.weights, normals[truth.triangle].astype(np.float64))[compared]
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.percentile(angles.degrees(found[compared], expected), 99) < NORMAL_P99


def shell(level, radius, noise=0.0, seed=0):
    """A sphere whose points lie up to `noise` off its radius: welded, because the noise depends on the place alone."""
    corners = oracle.icosphere(level)
    places, which = np.unique(corners.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    scale = radius + noise * (2.0 * np.random.default_rng(seed).random(len(places)) - 1.0)
    return (places * scale[:, None])[which.reshape(-1)].reshape(-1, 3, 3)


def smooth(corners):
    return corners / np.linalg.norm(corners, axis=2, keepdims=True)


@pytest.mark.slow
def test_own_hits_in_spheres_in_spheres_seed_1():
    """Each layer of the high mesh belongs to the layer of the low one that it is closest to."""
    rng = np.random.default_rng(1)
    low = np.concatenate([shell(1, radius) for radius in (0.6, 0.75, 0.9)])
    high = np.concatenate([shell(2, radius) for radius in (0.6, 0.76, 0.88)])
    check(rng, rays_from(rng, low, 0.05), high, smooth(high), low, expect={"own": 0.95})


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_own_hits_in_rough_shells_seeds_2_to_4(seed):
    rng = np.random.default_rng(seed)
    low = np.concatenate([shell(1, radius, 0.12, seed) for radius in (0.6, 0.7, 0.8)])
    high = np.concatenate([shell(2, radius, 0.08, seed + 9) for radius in (0.5, 0.62, 0.75, 0.83)])
    check(rng, rays_from(rng, low, 0.6), high, smooth(high), low, expect={"own": 0.5, "not owned": 0.02})


def test_hits_by_their_order_in_rough_shells_seed_11():
    """The layers of the two meshes are farther apart than each mesh's own, which cross each other here and there."""
    rng = np.random.default_rng(11)
    low = np.concatenate([shell(1, radius, 0.05, 11) for radius in (0.6, 0.7, 0.8)])
    high = np.concatenate([shell(2, radius, 0.02, 12) for radius in (0.67, 0.77, 0.87)])
    high = high[rng.random(len(high)) < 0.8]  # where one is missing, there are not as many
    check(rng, rays_from(rng, low, 0.1), high, smooth(high), low, by_order=True, expect={"own": 0.5, "not owned": 0.05})


@pytest.mark.parametrize("facing_only", [False, True])
@pytest.mark.parametrize("seed", [5, 6])
def test_own_hits_in_soups_seeds_5_and_6(seed, facing_only):
    """Triangles without neighbors: most hits belong to none, or are of the wrong side."""
    rng = np.random.default_rng(seed)
    low = rng.random((40, 1, 3)) + (rng.random((40, 3, 3)) - 0.5) * 0.6
    high = rng.random((60, 1, 3)) + (rng.random((60, 3, 3)) - 0.5) * 0.7
    normals = np.cross(high[:, 1] - high[:, 0], high[:, 2] - high[:, 0])[:, None] + 0.05 * rng.normal(size=high.shape)
    behind = "missed" if facing_only else "from behind"
    check(
        rng,
        rays_from(rng, low, 0.3),
        high,
        normals,
        low,
        facing_only=facing_only,
        expect={"own": 0.05, "not owned": 0.1, behind: 0.1},
    )


@pytest.mark.slow
def test_own_hits_of_a_low_mesh_with_edges_of_three_triangles_seed_7():
    rng = np.random.default_rng(7)
    fins = shell(0, 0.8).copy()
    fins[:, 2] *= rng.uniform(0.6, 1.6, (len(fins), 1))  # each shares one edge with the sphere
    low = np.concatenate([shell(0, 0.8), fins])
    high = np.concatenate([shell(2, radius, 0.02, 7) for radius in (0.78, 0.85)])
    check(rng, rays_from(rng, low, 0.2), high, smooth(high), low, expect={"own": 0.3})


def wedge(n, thickness, shift=0.0):
    """Two square sheets of n x n quads that meet at the edge x = shift, above and below z = 0: a sharp wedge."""
    x, y = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n)
    points = np.stack([x.ravel(), y.ravel(), thickness * x.ravel()], axis=1)
    first = (x[:-1, :-1] * n + y[:-1, :-1] * n * (n + 1)).round().astype(int).ravel()
    quads = np.stack([first, first + 1, first + n + 2, first + n + 1], axis=1)
    upper = points[np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])]
    return np.concatenate([upper, upper[:, ::-1] * (1, 1, -1)]) + (shift, 0, 0)


def test_own_hits_at_a_sharp_fold_seeds_9():
    """Beyond 60 degrees of inner angle, the two sides of a fold are not one surface, though they touch."""
    rng = np.random.default_rng(9)
    low = np.concatenate([wedge(3, 0.2), wedge(2, 0.4, 1.2)])
    high = np.concatenate([wedge(5, 0.17, 0.01), wedge(4, 0.45, 1.15)])
    high = high + 0.01 * np.sin(high * 20)
    faces = np.cross(high[:, 1] - high[:, 0], high[:, 2] - high[:, 0])[:, None]
    check(
        rng,
        rays_from(rng, low, 0.8),
        high,
        faces / np.linalg.norm(faces, axis=2, keepdims=True) + 0.3 * rng.normal(size=high.shape),
        low,
        expect={"own": 0.5, "not owned": 0.02},
    )


def test_own_hits_of_a_fine_low_mesh_seed_10():
    """Slanted rays: the closest points of some hits are farther away than the walk goes."""
    rng = np.random.default_rng(10)
    n = 60
    x = np.arange(n + 1) / n * 2.0
    points = np.stack([np.repeat(x, 2), np.tile((0.0, 0.3), n + 1), 0.02 * rng.normal(size=2 * n + 2)], axis=1)
    first = 2 * np.arange(n)[:, None]
    low = points[np.concatenate([first + (0, 2, 1), first + (1, 2, 3)])]
    high = np.concatenate([sheet(0.25), sheet(0.35)])
    normals = np.tile((0.0, 0.0, 1.0), (len(high), 3, 1))
    check(rng, rays_from(rng, low, 0.6), high, normals, low, expect={"own": 0.3, "not owned": 0.1})


@pytest.mark.parametrize("facing_only", [False, True])
def test_the_nearest_hit_seed_8(facing_only):
    rng = np.random.default_rng(8)
    low = shell(1, 0.7)
    high = rng.random((200, 1, 3)) * 1.6 - 0.8 + (rng.random((200, 3, 3)) - 0.5) * 0.5
    check(
        rng,
        rays_from(rng, low, 0.3),
        high,
        high,
        low,
        rule=Hit.NEAREST,
        facing_only=facing_only,
        expect={"own": 0.2, "missed": 0.2},
    )


# Known answers


def sheet(height, *, up=True):
    """Two triangles of the square -2..2 at z = height."""
    corners = np.array([(-2, -2, height), (2, -2, height), (2, 2, height), (-2, 2, height)], np.float32)
    return corners[[(0, 1, 2), (0, 2, 3)] if up else [(0, 2, 1), (0, 3, 2)]]


def sheets(*heights, up=True):
    return np.concatenate([sheet(height, up=up) for height in heights])


def height_over(low, high, own=0, *, start=0.5, **options):
    """What a ray upwards from (0.3, 0.2) on the triangle `own` of `low` finds: its height or None, and its flags."""
    normals = np.repeat(np.cross(high[:, 1] - high[:, 0], high[:, 2] - high[:, 0])[:, None], 3, axis=1)
    across = edges.neighbors(low.reshape(-1, 3), np.arange(low.size // 3).reshape(-1, 3))
    places = np.tile(np.float32((0.3, 0.2, low[own, 0, 2])), (SIZE * SIZE, 1))
    away = np.tile(np.float32((0, 0, 1)), (SIZE * SIZE, 1))
    rays = owner_oracle.Rays(places, away, np.full(SIZE * SIZE, own), start, INSIDE)
    height, is_hit, is_not_owned, is_from_behind, _ = (
        values[0] for values in trace(rays, high, normals, low, across, **options)
    )
    return (round(float(height), 5) if is_hit else None), bool(is_not_owned), bool(is_from_behind)


def test_each_low_layer_takes_its_high_layer():
    low, high = sheets(0.0, 0.3), sheets(0.05, 0.32)
    assert height_over(low, high) == (0.05, False, False)
    assert height_over(low, high, own=2) == (0.02, False, False)
    assert height_over(low, high, rule=Hit.OUTERMOST) == (0.32, False, False)


def test_as_many_layers_of_both_meshes_are_matched_by_their_order():
    """All high layers lie farther outside than half the gap between two of them."""
    low, high = sheets(0.0, 0.1, 0.2), sheets(0.07, 0.17, 0.27)
    assert [height_over(low, high, own=own)[:2] for own in (0, 2)] == [(0.07, True), (-0.03, False)]
    assert [height_over(low, high, own=own, by_order=True) for own in (0, 2, 4)] == [(0.07, False, False)] * 3
    for others in (sheets(0.07, 0.17), sheets(0.07, 0.17, 0.27, 0.37)):  # not as many: the owners decide
        assert height_over(low, others, own=2, by_order=True) == height_over(low, others, own=2)
    low, high = sheets(0.0, 0.1), sheets(0.04, 0.03)
    below = {"own": 2, "start": -0.02}  # the ray does not meet the place itself
    assert height_over(low, high, by_order=True, **below) == height_over(low, high, **below)


def test_what_stands_off_wins_over_what_lies_below_it():
    assert height_over(sheets(0.0), sheets(-0.01, 0.2)) == (0.2, False, False)


def test_without_an_owned_hit_the_nearest_that_faces_the_ray_counts_and_is_flagged():
    low = sheets(0.0, 0.3)
    assert height_over(low, sheets(0.2, 0.4)) == (0.2, True, False)
    assert height_over(low, np.concatenate([sheets(0.25), sheets(0.01, up=False)])) == (0.25, True, False)


def test_without_a_front_the_nearest_back_counts_and_is_flagged_unless_only_fronts_may_be_hit():
    low, high = sheets(0.0), sheets(0.2, -0.1, up=False)
    assert height_over(low, high) == (-0.1, False, True)
    assert height_over(low, high, facing_only=True) == (None, False, False)


def test_hits_are_asked_for_their_owner_up_to_a_bound():
    """Layers that belong to another low layer lie above the own one. A ray through very many of them still ends."""
    low = sheets(0.0, 0.3)
    for count, expected in ((CANDIDATES, (0.05, False, False)), (CANDIDATES + 20, (None, True, False))):
        above = np.linspace(0.45, 0.25, count)
        height, *flags = height_over(low, np.concatenate([sheets(*above), sheets(0.05)]))
        assert flags == list(expected[1:]), count
        assert height == expected[0] or expected[0] is None


@pytest.mark.parametrize(("cosine", "is_strictly_owned"), [(0.95, True), (0.85, False)])
@pytest.mark.parametrize(("room", "is_near"), [(0.3, True), (0.1, False)])
def test_beyond_the_room_a_hit_belongs_only_to_texels_about_at_its_closest_point(
    cosine, is_strictly_owned, room, is_near
):
    """Slanted rays over a plane: the closest point of a hit is `cosine` of the ray's length away."""
    low, high = sheet(0.0), sheet(0.2 * cosine)
    low, high = (np.ascontiguousarray(corners, np.float32) for corners in (low, high))
    across = edges.neighbors(low.reshape(-1, 3), np.arange(low.size // 3).reshape(-1, 3))
    away = np.broadcast_to(np.float32((np.sqrt(1.0 - cosine**2), 0.0, cosine)), (SIZE * SIZE, 3))
    places = np.broadcast_to(np.float32((-0.5, -0.6, 0.0)), away.shape)
    own = np.full(SIZE * SIZE, np.argmin(np.abs(low[:, :, :2].mean(axis=1) - places[0, :2]).sum(axis=1)))
    rays = owner_oracle.Rays(places, away, own, START, INSIDE)
    normals = np.tile(np.float32((0.0, 0.0, 1.0)), (len(high), 3, 1))
    height, is_hit, is_not_owned, _, _ = trace(rays, high, normals, low, across, room=room)
    assert is_hit.all()
    np.testing.assert_allclose(height, 0.2, atol=1e-5)
    assert (is_not_owned == (not (is_near or is_strictly_owned))).all()


def flat_grid(n, height):
    """The triangles of a grid of n x n squares over -1..1."""
    x = np.linspace(-1.0, 1.0, n + 1)
    points = np.stack([np.tile(x, n + 1), np.repeat(x, n + 1), np.full((n + 1) ** 2, height)], axis=1)
    first = (np.arange(n)[None, :] + (n + 1) * np.arange(n)[:, None]).reshape(-1, 1)
    return points[np.concatenate([first + (0, 1, n + 2), first + (0, n + 2, n + 1)])]


def upright_hits(low, *heights):
    """The height (N,) and whether it is not owned, of upright rays from the lowest part of `low` to sheets at these heights."""
    low, high = (
        np.ascontiguousarray(corners, np.float32) for corners in (low, np.concatenate([sheet(z) for z in heights]))
    )
    across = edges.neighbors(low.reshape(-1, 3), np.arange(low.size // 3).reshape(-1, 3))
    bottom = np.flatnonzero(low[:, :, 2].max(axis=1) == low[..., 2].min())
    own = np.resize(bottom, SIZE * SIZE)
    away = np.broadcast_to(np.float32((0.0, 0.0, 1.0)), (SIZE * SIZE, 3))
    rays = owner_oracle.Rays(low[own].mean(axis=1), away, own, START, INSIDE)
    height, is_hit, is_not_owned, _, _ = trace(
        rays, high, np.tile(np.float32((0, 0, 1)), (len(high), 3, 1)), low, across
    )
    assert is_hit.all()
    return height, is_not_owned


@pytest.mark.parametrize(("share", "is_own"), [(0.45, True), (0.55, False)])
def test_a_hit_belongs_to_the_closer_of_two_fine_layers(share, is_own):
    """The layers are 0.45 radii of a triangle apart: alone, the lower one would have a clearance of half a radius."""
    gap = 0.45 * 0.1 * np.sqrt(5.0) / 3.0
    _, is_not_owned = upright_hits(np.concatenate([flat_grid(20, 0.0), flat_grid(20, gap)]), share * gap)
    assert (is_not_owned != is_own).all()


def test_a_texel_below_many_layers_finds_its_own():
    layers = [0.3 + 0.01 * i for i in range(10)]
    height, is_not_owned = upright_hits(np.concatenate([sheet(0.0), sheet(0.35)]), 0.01, *layers)
    np.testing.assert_allclose(height, 0.01, atol=1e-6)
    assert not is_not_owned.any()
