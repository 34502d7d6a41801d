# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests rays on the GPU against a float64 ray caster that tests every triangle."""

import gpu
import numpy as np
import pytest

from addon.core.declarations.choices import Hit
from addon.mesh import bvh
from addon.passes import cast, target
from tests.support import angles, oracle

pytestmark = pytest.mark.usefixtures("gpu_context")

SAME_TRIANGLE = 0.999
"""Share of rays. A ray that hits an edge may report either of its triangles."""
NORMAL_P99 = 0.01
"""Degrees."""
SIZE = 64


def tables(corners, normals=None):
    corners = np.asarray(corners, np.float32)
    numbers = np.arange(len(corners) * 3).reshape(-1, 3)
    normals = corners if normals is None else np.asarray(normals, np.float32)
    points, normals = corners.reshape(-1, 3), normals.reshape(-1, 3)
    tree = bvh.build(points, numbers)
    sorted_numbers = numbers[tree.order]
    uploaded = cast.upload(
        tree,
        points,
        sorted_numbers,
        normals,
        np.zeros(len(numbers), int),
    )
    return uploaded, tree.order


def ray_target(origins, directions, start=0.0, mask=None):
    """SIZE x SIZE rays along `directions`, in the layout that rays.draw writes. start: they begin that much earlier."""
    drawn = target.Target(SIZE, SIZE, ("RGBA32F", "RGBA32F"))
    for slot, (values, alpha) in enumerate(((origins, 1.0 if mask is None else mask), (-directions, start))):
        texels = np.ones((SIZE, SIZE, 4), np.float32)
        texels[..., :3] = values.reshape(SIZE, SIZE, 3)
        texels[..., 3] = alpha
        drawn.textures[slot] = gpu.types.GPUTexture(
            (SIZE, SIZE), format="RGBA32F", data=gpu.types.Buffer("FLOAT", texels.shape, texels)
        )
    return drawn


def trace(
    origins,
    directions,
    corners,
    *,
    normals=None,
    max_t=100.0,
    inside=1e8,
    start=0.0,
    facing_only=False,
    mask=None,
    rule=Hit.OUTERMOST,
):
    """Trace rays. Returns distances (N,), -1 for a miss, normals (N, 3) and the alpha (N,) that look_up wrote."""
    uploaded, _ = tables(corners, normals)
    drawn = ray_target(origins, directions, start, mask)
    hits = target.Target(SIZE, SIZE, ("RGBA32UI",))
    cast.trace(hits, drawn, uploaded, None, cast.Search(rule, inside, max_t, facing_only))
    found = target.Target(SIZE, SIZE, ("RGBA32F",))
    heights, looked_up = (np.empty((SIZE, SIZE, 4), np.float32) for _ in range(2))
    cast.heights(found, hits, drawn)
    found.read(heights)
    cast.look_up(found, hits, drawn, uploaded, np.eye(3))
    found.read(looked_up)
    looked_up, heights = looked_up.reshape(-1, 4), heights.reshape(-1, 4)
    assert np.array_equal(heights[:, 3], looked_up[:, 3])
    far = np.where(heights[:, 3] > 0.0, np.float32(start) - heights[:, 0], np.float32(-1.0))
    return far, looked_up[:, :3].astype(np.float64), looked_up[:, 3]


def soup(rng, count, size):
    return rng.random((count, 1, 3)) + (rng.random((count, 3, 3)) - 0.5) * size


def random_rays(rng):
    directions = rng.normal(size=(SIZE * SIZE, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = 0.5 - directions * 2.0 + (rng.random((SIZE * SIZE, 3)) - 0.5)
    return origins.astype(np.float32), directions.astype(np.float32)


def check(origins, directions, corners, normals, **options):
    corners, normals = np.asarray(corners, np.float32), np.asarray(normals, np.float32)
    far, found, alpha = trace(origins, directions, corners, normals=normals, **options)
    triangle, distance, weights, _ = oracle.first_hits(origins, directions, corners, options.get("max_t", 100.0))
    hit = triangle >= 0
    # The distance and the normal identify a hit: no two triangles of a random soup share both.
    truth = (normals[triangle].astype(np.float64) * weights[..., None]).sum(axis=1)
    truth /= np.maximum(np.linalg.norm(truth, axis=1, keepdims=True), 1e-12)
    same = np.where(hit, np.abs(far - np.where(hit, distance, 0.0)) < 1e-4, far < 0.0)
    print(f"{hit.mean():.1%} hit, same in {same.mean():.4%}")
    assert hit.mean() > 0.1  # otherwise the case tests nothing
    assert same.mean() >= SAME_TRIANGLE
    error = angles.degrees(found[hit & same], truth[hit & same])
    assert np.percentile(error, 99) < NORMAL_P99
    assert np.array_equal(alpha, np.where(far >= 0.0, 1.0, -1.0))


@pytest.mark.parametrize(
    ("seed", "count", "size"), [(1, 1, 3.0), (2, 5, 1.0), (3, 300, 0.3), (4, 700, 0.1), (5, 300, 2.0)]
)
def test_random_soups_seeds_1_to_5(seed, count, size):
    rng = np.random.default_rng(seed)
    corners = soup(rng, count, size)
    normals = rng.normal(size=(count, 1, 3)) + 0.3 * rng.normal(size=(count, 3, 3))
    check(*random_rays(rng), corners, normals)


def test_rays_stop_at_max_t_seed_6():
    rng = np.random.default_rng(6)
    corners = soup(rng, 500, 0.5)
    check(*random_rays(rng), corners, rng.normal(size=(500, 3, 3)), max_t=1.7)


def test_a_sphere_is_hit_on_its_surface_seed_8():
    rng = np.random.default_rng(8)
    corners = oracle.icosphere(3)
    origins, directions = random_rays(rng)
    outwards = -directions
    far, found, _ = trace(outwards * 3.0, directions, corners, normals=corners)
    assert (far > 0).all()
    assert np.abs(far - 2.0).max() < 0.02  # facets lie up to this far below the sphere
    assert angles.degrees(found, outwards / np.linalg.norm(outwards, axis=1, keepdims=True)).max() < 0.5


def test_no_ray_leaves_a_closed_mesh_seeds_0_to_9():
    """Rays start inside, at ten rotations. Some aim at edges and corners."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        # The last mesh has 327,680 triangles: its tree is deep, and single precision is coarse for such small triangles.
        corners = oracle.icosphere(4 if seed < 9 else 7) @ oracle.rotation(rng).T
        flat = corners.reshape(-1, 3, 3)[rng.integers(0, len(corners), SIZE * SIZE)]
        mix = rng.random(SIZE * SIZE)[:, None]
        kind = rng.integers(0, 3, SIZE * SIZE)[:, None]
        aim = np.where(kind == 0, flat[:, 0], flat[:, 0] * mix + flat[:, 1] * (1 - mix))
        aim = np.where(kind == 2, rng.normal(size=aim.shape), aim)
        directions = (aim / np.linalg.norm(aim, axis=1, keepdims=True)).astype(np.float32)
        far, _, _ = trace(np.zeros_like(directions), directions, corners)
        assert (far > 0.0).all(), f"seed {seed}: {np.count_nonzero(far < 0)} rays leaked"


def test_axis_parallel_rays_hit_axis_parallel_boxes():
    """Slab tests can produce NaN for zero components and for rays inside a box's face."""
    plane = [[(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(0, 0, 0), (1, 1, 0), (0, 1, 0)]]
    x, y = np.meshgrid((np.arange(SIZE) + 0.5) / SIZE, (np.arange(SIZE) + 0.5) / SIZE)
    origins = np.stack([x.ravel(), y.ravel(), np.ones(SIZE * SIZE)], axis=1).astype(np.float32)
    directions = np.broadcast_to(np.float32((0, 0, -1)), origins.shape)
    far, _, _ = trace(origins, directions, plane)
    assert np.allclose(far, 1.0, atol=1e-6)


def test_facing_only_ignores_back_faces():
    front = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    back = [(0, 0, 1), (0, 1, 1), (1, 0, 1)]  # above, facing down
    origins = np.broadcast_to(np.float32((0.2, 0.2, 2.0)), (SIZE * SIZE, 3))
    directions = np.broadcast_to(np.float32((0, 0, -1)), origins.shape)
    assert np.allclose(trace(origins, directions, [front, back])[0], 1.0)
    assert np.allclose(trace(origins, directions, [front, back], facing_only=True)[0], 2.0)


def test_texels_without_a_low_mesh_cast_no_rays():
    mask = np.zeros((SIZE, SIZE))
    mask[:, ::2] = 1.0
    origins = np.broadcast_to(np.float32((0.2, 0.2, 2.0)), (SIZE * SIZE, 3))
    directions = np.broadcast_to(np.float32((0, 0, -1)), origins.shape)
    far, _, alpha = trace(origins, directions, [[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], mask=mask)
    assert np.array_equal(alpha.reshape(SIZE, SIZE), mask)
    assert (far.reshape(SIZE, SIZE)[:, 1::2] == -1.0).all()


def test_start_offset_moves_the_start_of_the_ray_back():
    origins = np.broadcast_to(np.float32((0.2, 0.2, -0.5)), (SIZE * SIZE, 3))  # already past the triangle
    directions = np.broadcast_to(np.float32((0, 0, -1)), origins.shape)
    triangle = [[(0, 0, 0), (1, 0, 0), (0, 1, 0)]]
    assert (trace(origins, directions, triangle)[0] == -1.0).all()
    assert np.allclose(trace(origins, directions, triangle, start=0.75)[0], 0.25)


def test_rays_end_below_the_low_surface():
    origins = np.broadcast_to(np.float32((0.2, 0.2, 2.0)), (SIZE * SIZE, 3))
    directions = np.broadcast_to(np.float32((0, 0, -1)), origins.shape)
    triangle = [[(0, 0, 0), (1, 0, 0), (0, 1, 0)]]
    assert np.allclose(trace(origins, directions, triangle, start=1.0, inside=2.01)[0], 3.0)
    assert (trace(origins, directions, triangle, start=1.0, inside=1.99)[0] == -1.0).all()
    assert (trace(origins, directions, triangle, start=1.0, inside=2.01, max_t=2.99)[0] == -1.0).all()


def test_the_nearest_hit_may_be_on_either_side():
    outer, inner = ([(0, 0, z), (1, 0, z), (0, 1, z)] for z in (1.0, -0.5))
    origins = np.broadcast_to(np.float32((0.2, 0.2, 0.0)), (SIZE * SIZE, 3))
    directions = np.broadcast_to(np.float32((0, 0, -1)), origins.shape)
    for triangles, expected in (([outer, inner], 0.5), ([outer], -1.0)):
        far = trace(origins, directions, triangles, start=2.0, rule=Hit.NEAREST)[0]
        assert np.allclose(far - 2.0, expected)
    assert np.allclose(trace(origins, directions, [outer, inner], start=2.0)[0] - 2.0, -1.0)
