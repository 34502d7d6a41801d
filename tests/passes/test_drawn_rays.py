# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests where rays start and which way they go, in closed form."""

import gpu
import numpy as np
import pytest

from addon.core import udim
from addon.core.declarations.choices import Hit
from addon.mesh import bvh
from addon.passes import cast, rays, target
from tests.support import angles, oracle
from tests.support.maps import texel_uv
from tests.support.raster import unit

pytestmark = pytest.mark.usefixtures("gpu_context")


SIZE = 64
EXACT = 2e-6
"""In components of unit vectors and of places up to 1: single precision, after interpolation."""
SHARE = 2e-5
"""In components of unit vectors whose shares come from distances that single precision has computed."""
SQUARE = np.float32([(0, 0), (1, 0), (1, 1), (0, 1)])
HALVES = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
UP = np.array((0.0, 0.0, 1.0))


def edges_of(ends):
    """Hard edges with a tree over them, from ends (E, 2, 3)."""
    ends = np.float32(ends)
    numbers = np.arange(len(ends) * 2).reshape(-1, 2)
    tree = bvh.build(ends.reshape(-1, 3), numbers[:, [0, 1, 1]])
    return rays.upload_edges(tree, ends[tree.order])


def draw(
    *,
    uv=SQUARE,
    triangles=HALVES,
    position=None,
    smooth=UP,
    straight=UP,
    numbers=(1, 2),
    paint=None,
    edges=None,
    share=0.0,
    width=0.0,
    start=0.0,
    on_cage=False,
):
    """Draw the rays of a square, whose positions are its UVs at z = 0. Normals (3,) are the same at all corners.

    Returns places, numbers, directions and starts, (SIZE, SIZE, n) each.
    """
    uv = np.float32(uv)
    position = np.pad(uv, ((0, 0), (0, 1))) if position is None else np.float32(position)
    mesh = rays.upload(
        np.int32(triangles),
        np.asarray(numbers),
        uv=uv,
        position=position,
        smooth_normal=np.broadcast_to(np.float32(smooth), position.shape),
        straight_normal=np.broadcast_to(np.float32(straight), position.shape),
        paint=None if paint is None else np.float32(paint),
    )
    drawn = target.Target(SIZE, SIZE, ("RGBA32F", "RGBA32F"))
    directions = rays.Directions(rays.no_edges() if edges is None else edges, straight_share=share, blend_width=width)
    rays.draw(drawn, mesh, udim.uv_to_clip(1001), directions, start_offset=start, start_on_cage=on_cage)
    places, away = np.empty((2, SIZE, SIZE, 4), np.float32)
    drawn.read(places)
    drawn.read(away, slot=1)
    return places[..., :3], places[..., 3], away[..., :3], away[..., 3]


def blended(smooth, straight, share):
    share = np.clip(share, 0.0, 1.0)[..., None]
    return unit(unit(np.asarray(smooth)) * (1.0 - share) + unit(np.asarray(straight)) * share)


def smoothstep(x):
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def distances(points, ends):
    """The distances (N,) of points (N, 3) from the nearest of the segments (E, 2, 3), each one tested."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip(((points[:, None] - start) * along).sum(axis=2) / length, 0.0, 1.0)
    return np.linalg.norm(start + share[..., None] * along - points[:, None], axis=2).min(axis=1)


def test_places_and_numbers_are_those_of_the_low_mesh():
    most = rays.MOST_TRIANGLES
    for numbers in ((1, 2), (4095, 4096), (4097, 8192), (most - 4096, most)):
        places, number, _, _ = draw(numbers=numbers)
        expected = np.pad(texel_uv(SIZE, SIZE), ((0, 0), (0, 0), (0, 1)))
        assert np.abs(places - expected).max() < EXACT
        upper = np.greater(*np.moveaxis(texel_uv(SIZE, SIZE), -1, 0)[::-1])
        lower = upper.T
        assert (number[upper] == numbers[1]).all()
        assert (number[lower] == numbers[0]).all()


def test_texels_without_a_low_mesh_have_no_ray():
    _, number, _, start = draw(uv=SQUARE * 0.5, start=0.3)
    assert np.count_nonzero(number) == SIZE * SIZE / 4
    assert np.array_equal(start > 0.0, number > 0.0)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_directions_have_a_share_of_the_straight_normals(share):
    smooth, straight = (0.0, 0.6, 0.8), (3.0, 0.0, 4.0)  # of any length
    _, _, away, _ = draw(smooth=smooth, straight=straight, share=share)
    assert np.abs(away - blended(smooth, straight, np.float64(share))).max() < EXACT


@pytest.mark.parametrize("width", [0.1, 0.3, 2.0])
def test_directions_beside_a_hard_edge_turn_from_smooth_to_straight(width):
    """Two faces of a box fold along the line u = 0.5. The smooth normals there point halfway between the faces."""
    uv = np.array([(0, 0), (0.5, 0), (0.5, 1), (0, 1), (0.5, 0), (1, 0), (1, 1), (0.5, 1)])
    side = np.repeat((0, 1), 4)
    from_edge = np.abs(uv[:, 0] - 0.5)
    position = np.stack([from_edge * (side == 1), uv[:, 1], -from_edge * (side == 0)], axis=1)
    straight = np.where(side[:, None] == 0, (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    halfway = np.array((-1.0, 0.0, 1.0)) / np.sqrt(2.0)
    smooth = np.where((from_edge > 0.0)[:, None], straight, halfway)
    _, _, away, _ = draw(
        uv=uv,
        triangles=[(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)],
        numbers=(1, 2, 3, 4),
        position=position,
        smooth=smooth,
        straight=straight,
        edges=edges_of([[(0, 0, 0), (0, 1, 0)]]),
        width=width,
    )
    u = texel_uv(SIZE, SIZE)[..., 0]
    distance = np.abs(u - 0.5)
    face = np.where((u < 0.5)[..., None], (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    interpolated = face * (distance / 0.5)[..., None] + halfway * (1.0 - distance / 0.5)[..., None]
    expected = blended(interpolated, face, smoothstep(distance / width))
    assert np.abs(away - expected).max() < SHARE


@pytest.mark.parametrize("count", [1, 3, 40, 700])
def test_the_nearest_hard_edge_decides_seed_1(count):
    """Against the distances to all edges. Some edges have no length."""
    rng = np.random.default_rng(1)
    ends = np.float32(rng.random((count, 1, 3)) * (1, 1, 0.3) + (rng.random((count, 2, 3)) - 0.5) * 0.2)
    ends[::7, 1] = ends[::7, 0]
    width = 0.3
    smooth, straight = (0.0, 0.0, 1.0), (0.8, 0.0, 0.6)
    _, _, away, _ = draw(smooth=smooth, straight=straight, edges=edges_of(ends), width=width)
    points = np.pad(texel_uv(SIZE, SIZE), ((0, 0), (0, 0), (0, 1))).reshape(-1, 3)
    share = smoothstep(distances(points, ends.astype(np.float64)) / width).reshape(SIZE, SIZE)
    assert np.ptp(share) > 0.3  # otherwise the case tests nothing
    assert np.abs(away - blended(smooth, straight, share)).max() < SHARE


def test_painted_values_are_added_to_the_share():
    """From -1 on the left to 1 on the right, on top of 0.25."""
    paint = np.stack([np.ones(4), SQUARE[:, 0] * 2.0 - 1.0], axis=1)
    smooth, straight = (0.0, 0.6, 0.8), (0.6, 0.0, 0.8)
    _, _, away, _ = draw(smooth=smooth, straight=straight, share=0.25, paint=paint)
    share = 0.25 + texel_uv(SIZE, SIZE)[..., 0] * 2.0 - 1.0
    assert share.min() < 0.0
    assert share.max() > 1.0
    assert np.abs(away - blended(smooth, straight, share)).max() < EXACT


def test_painted_factors_multiply_where_rays_start():
    paint = np.stack([SQUARE[:, 1] * 2.0, np.zeros(4)], axis=1)
    _, _, _, start = draw(start=0.4, paint=paint)
    assert np.abs(start - 0.4 * 2.0 * texel_uv(SIZE, SIZE)[..., 1]).max() < EXACT
    assert (draw(start=0.4)[3] == np.float32(0.4)).all()


def test_rays_start_on_the_cage():
    """Its distance, the length of the smooth normals, grows from 0.2 to 0.6 with u. It leans, and so do the rays."""
    lean = np.array((0.6, 0.0, 0.8))
    to_cage = lean * (0.2 + 0.4 * SQUARE[:, :1])
    _, _, away, start = draw(smooth=to_cage, straight=to_cage, on_cage=True, start=9.0)
    u = texel_uv(SIZE, SIZE)[..., 0]
    assert np.abs(start - (0.2 + 0.4 * u)).max() < EXACT
    assert np.abs(away - lean).max() < EXACT
    doubled = np.tile((2.0, 0.0), (4, 1))
    assert np.abs(draw(smooth=to_cage, straight=to_cage, on_cage=True, paint=doubled)[3] - 2.0 * start).max() < EXACT


def test_texels_without_a_smooth_normal_have_no_ray():
    for value in (0.0, 1e-17, np.inf, np.nan):
        assert not draw(smooth=(0.0, value, 0.0))[1].any()


def test_a_missing_straight_normal_leaves_the_smooth_one():
    _, _, away, _ = draw(smooth=(0.0, 0.6, 0.8), straight=(0.0, 0.0, 0.0), share=1.0)
    assert np.abs(away - (0.0, 0.6, 0.8)).max() < EXACT


def test_opposite_normals_have_a_direction():
    _, _, away, _ = draw(smooth=(0.0, 0.0, 1.0), straight=(0.0, 0.0, -1.0), share=0.5)
    assert np.abs(away - (0.0, 0.0, -1.0)).max() < EXACT


@pytest.mark.parametrize("count", [0, 1, 64, 65, 1000])
def test_points_are_the_first_texels_seed_2(count):
    rng = np.random.default_rng(2)
    points, directions = rng.normal(size=(2, count, 3))
    directions[3:4] = 0.0
    drawn = rays.upload_points(points, directions, 0.5)
    places, away = np.empty((2, drawn.height, drawn.width, 4), np.float32)
    drawn.read(places)
    drawn.read(away, slot=1)
    places, away = places.reshape(-1, 4), away.reshape(-1, 4)
    assert drawn.width * drawn.height >= count
    has_ray = np.arange(len(places)) < count
    has_ray[3:4] = False
    assert np.array_equal(places[:, 3] > 0.0, has_ray)
    kept = has_ray[:count]
    assert np.abs(places[:count, :3] - points)[kept].max(initial=0.0) < EXACT
    assert (
        np.abs(away[:count][kept] - np.pad(unit(directions[kept]), ((0, 0), (0, 1)), constant_values=0.5)).max(
            initial=0.0
        )
        < EXACT
    )


# Cast


SAME_TRIANGLE = 0.999
"""Share of rays. A ray that hits an edge may report either of its triangles."""
NORMAL_P99 = 0.01
"""Degrees."""


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
