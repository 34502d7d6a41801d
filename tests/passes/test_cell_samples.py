# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests samples that are taken without drawing: each must find the triangle that is drawn over it."""

import numpy as np
import pytest

from addon.core import udim
from addon.mesh import uv_cells
from addon.passes import mesh_upload, target
from addon.passes.adaptive import cell_samples
from addon.passes.bake import flatten, samples

pytestmark = pytest.mark.usefixtures("gpu_context")

WIDTH, HEIGHT = 64, 48
SIZE = WIDTH, HEIGHT
TAKEN = [(offset, udim.uv_to_clip(size=SIZE, start=offset, count=SIZE)) for offset in samples.offsets(64)]


def soup(seed, count, extent, scales=(1, 2)):
    """Corners (2, 3, T) of triangles in UV space, on the grid to which rasterizers round: random ones of at most `extent` steps
    around a texel's corner, times one of `scales`. Some overlap, lie outside, are mirrored, or have no area, and many edges go
    through samples."""
    random = np.random.default_rng(seed)
    middle = random.integers(-8, np.array(SIZE)[:, None, None] + 8, (2, 1, count)) * 256
    corners = middle + random.integers(-extent, extent + 1, (2, 3, count)) * random.choice(scales, count)
    corners[:, 2, ::17] = corners[:, 1, ::17]
    return (corners / (256.0 * np.array(SIZE)[:, None, None])).astype(np.float32)


def sorted_into(uv, side, normals):
    cells = np.ones((-(-HEIGHT // side), -(-WIDTH // side)), bool)
    found = uv_cells.sort(uv, udim.uv_to_clip(), SIZE, cells, side)
    corners = uv.transpose(2, 1, 0)[found.triangles]
    return cell_samples.Sorted(found.starts, corners, found.planes(normals[found.triangles]))


def flat(values):
    """Values (T, C) of triangles at their corners (T, 3, C)."""
    return np.repeat(values[:, None].astype(np.float32), 3, axis=1)


def taken(found, side, stop=64):
    """The means (height, width, 4) of the samples from the third on."""
    shape = -(-HEIGHT // side), -(-WIDTH // side)
    sums = target.Target(WIDTH, HEIGHT, ("RGBA32F",))
    target.clear(sums)
    places = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).reshape(-1, 2)
    stops = np.broadcast_to(stop, (HEIGHT, WIDTH)).reshape(-1)
    records = cell_samples.upload(found, shape)
    steps = list(cell_samples.add(sums.texture, records, places, stops, TAKEN, side=side))
    assert steps == sorted(steps) and steps[-1] == 1.0
    return read(sums)


def read(into):
    result = np.empty((HEIGHT, WIDTH, 4), np.float32)
    into.read(result)
    return result


def drawn(uv, normals, stop=64):
    """The same means of samples that are drawn."""
    corners = uv.transpose(2, 1, 0).reshape(-1, 2).copy()
    batch = mesh_upload.upload_corners(uv=corners, normal=normals.reshape(-1, 3).copy())
    one, sums = (target.Target(WIDTH, HEIGHT, ("RGBA32F",)) for _ in range(2))
    for number, (_, to_clip) in enumerate(TAKEN[2:stop]):
        flatten.draw(one, [(batch, np.eye(3))], to_clip)
        samples.add(sums, one.texture, range(HEIGHT), is_first=number == 0)
    samples.average(one, sums)
    return read(one)


@pytest.mark.parametrize("side", [1, 4, 8])
@pytest.mark.parametrize(("seed", "count", "extent"), [(1, 400, 900), (2, 100, 1000), (3, 2000, 250), (4, 0, 1)])
def test_the_triangle_of_each_sample_is_the_one_that_is_drawn_there(seed, count, extent, side):
    uv = soup(seed, count, extent)
    # Rasterizers clip triangles at the border of the map, which samples move by half a texel, and round again.
    uv = uv[..., ((uv > 0.02) & (uv < 0.98)).all(axis=(0, 1))]
    normals = flat(np.random.default_rng(seed).normal(size=(uv.shape[2], 3)))
    found = taken(sorted_into(uv, side, normals), side)
    expected = drawn(uv, normals) if count else np.zeros_like(found)
    assert np.array_equal(found[..., 3], expected[..., 3])
    assert np.abs(found - expected).max() < 1e-5
    assert not count or expected[..., 3].mean() > 0.05


@pytest.mark.parametrize("seed", [7, 8])
def test_triangles_across_the_border_of_the_map_cover_the_same_but_for_the_rounding_of_clipped_edges(seed):
    uv, normals = soup(seed, 60, 6000, (1, 64, 128)), flat(np.random.default_rng(seed).normal(size=(60, 3)))
    found, expected = taken(sorted_into(uv, 8, normals), 8), drawn(uv, normals)
    assert np.array_equal(found[..., 3], expected[..., 3])
    unlike = (np.abs(found - expected).max(axis=2) > 1e-5).mean()
    assert unlike < 0.01


@pytest.mark.parametrize("seed", [5, 6])
def test_normals_between_corners_are_those_that_are_drawn(seed):
    random = np.random.default_rng(seed)
    uv = soup(seed, 50, 2000)
    normals = (random.normal(size=(50, 3, 3)) * 0.3 + (0, 0, 1)).astype(np.float32)
    found, expected = taken(sorted_into(uv, 8, normals), 8), drawn(uv, normals)
    assert np.array_equal(found[..., 3], expected[..., 3])
    assert 0.05 < expected[..., 3].mean() < 0.95
    # Slivers change quickly, and drivers interpolate them in their own precision.
    assert np.percentile(np.abs(found - expected).max(axis=2), 99) < 1e-4


def test_a_triangle_without_a_normal_leaves_the_one_below():
    uv = np.repeat(np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], np.float32)[..., None], 2, axis=2)
    normals = flat(np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 0.0]]))
    assert np.abs(taken(sorted_into(uv, 8, normals), 8) - (0.0, 0.6, 0.8, 1.0)).max() < 1e-6


def test_texels_take_as_many_samples_as_they_are_listed_with():
    uv = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], np.float32)[..., None] * 0.7
    normals = flat(np.array([[0.0, 0.0, 1.0]]))
    found = taken(sorted_into(uv, 8, normals), 8, stop=5)
    assert np.array_equal(found[..., 3], drawn(uv, normals, stop=5)[..., 3])
    assert (taken(sorted_into(uv, 8, normals), 8, stop=2) == 0.0).all()


@pytest.mark.parametrize("extent", [8, 24])
def test_all_samples_of_crowded_cells_are_taken_seed_9(extent):
    """Where most samples meet nothing, they look at all triangles of their cell."""
    random, count = np.random.default_rng(9), 6000
    middle = random.integers(24 * 256, 32 * 256, (2, 1, count))
    corners = middle + random.integers(-extent, extent + 1, (2, 3, count))
    uv = (corners / (256.0 * np.array(SIZE)[:, None, None])).astype(np.float32)
    normals = flat(random.normal(size=(count, 3)))
    stops = np.where(np.indices((HEIGHT, WIDTH)).sum(axis=0) % 2, 40, 64)
    found = taken(sorted_into(uv, 8, normals), 8, stops)
    expected = np.where(stops[..., None] == 40, drawn(uv, normals, stop=40), drawn(uv, normals))
    assert np.array_equal(found[..., 3], expected[..., 3])
    assert np.abs(found - expected).max() < 1e-5
    assert expected[..., 3].sum() > 30


def test_triangles_without_area_are_in_no_cell():
    corners = np.array([[[0.3, 0.3, 0.3]] * 2, [[0.1, 0.1, 0.5]] * 2, [[0.1, 0.5, 0.1]] * 2, [[0.5, 0.1, 0.1]] * 2])
    whole = np.array([[[0.1, 0.5, 0.1], [0.1, 0.1, 0.5]]])
    uv = np.concatenate([corners, whole]).transpose(1, 2, 0).astype(np.float32)
    found = uv_cells.sort(uv, udim.uv_to_clip(), SIZE, np.ones((6, 8), bool), 8)
    assert set(found.triangles.tolist()) == {4}
