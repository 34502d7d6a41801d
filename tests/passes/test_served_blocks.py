# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that a pass over an image runs only on the blocks of a map that show it."""

import numpy as np
import pytest

from addon.core.material_feeds import ImageFeed
from addon.passes import shader, surface_tables, target
from tests.support.seen_surface import SeenSurface, grid, page

pytestmark = pytest.mark.usefixtures("gpu_context")


def scattered(seed, count=150, size=(200, 130)):
    """A surface of many materials and some holes."""
    rng = np.random.default_rng(seed)
    triangles = grid(23, 17)
    keep = rng.random(len(triangles)) < 0.7
    return SeenSurface(triangles[keep], size, materials=rng.integers(1, count, keep.sum()))


@pytest.fixture
def groups(monkeypatch):
    """The numbers of workgroups of each pass that runs on blocks."""
    counted, whole = [], target.dispatch_groups

    def count(program, groups, **bindings):
        if "blocks" in bindings:
            counted.append(groups[0] * groups[1])
        whole(program, groups, **bindings)

    monkeypatch.setattr(target, "dispatch_groups", count)
    return counted


def test_each_block_lists_its_materials_seed_1():
    """Against the labels of the hits, drawn as constants: material m has the color m."""
    seen = scattered(1)
    seen.begin(surface_tables.upload_materials(np.zeros(150, int), np.repeat(np.arange(150)[:, None], 3, axis=1)))
    sums = seen.read()
    blocks = surface_tables.find_blocks(seen.hits, seen.labels)
    assert blocks.masks.shape == (5, 7, 4)
    for number in range(1, 150):
        same_bit = (sums[..., 3] == 1.0) & (sums[..., 0] % 96 == number % 96)
        padded = np.pad(same_bit, ((0, 160 - 130), (0, 224 - 200))).reshape(5, 32, 7, 32)
        expected = np.argwhere(padded.any(axis=(1, 3)))[:, ::-1]
        feeds = np.zeros(150, int)
        feeds[number] = 3
        found = blocks.serving(surface_tables.upload_materials(feeds), 3)
        assert np.array_equal(found, expected)


def test_maps_are_the_same_by_blocks_and_whole_seed_2(groups):
    seen = scattered(2, count=6)
    shown = page(np.random.default_rng(2).random((64, 64)))
    materials = surface_tables.upload_materials(np.array((-1, 1, 2, 2, 0, 1, 3)))
    blocks = surface_tables.find_blocks(seen.hits, seen.labels)
    maps = []
    for where in (None, blocks):
        seen.begin(materials)
        for number in (1, 2):
            seen.add(shown, ImageFeed("a"), materials, number, blocks=where)
        maps.append(seen.read())
    assert np.array_equal(*maps)
    assert len(np.unique(maps[0])) > 1000
    assert groups[0] == 5 * 7 * 16


def test_only_blocks_that_show_the_image_run(groups):
    triangles = grid(4, 4)
    seen = SeenSurface(triangles, (256, 128), materials=1 + (triangles.mean(axis=1)[:, 0] > 0.75))
    blocks = surface_tables.find_blocks(seen.hits, seen.labels)
    for feeds in ((0, 0, 1), (0, 1, 0), (0, 0, 0)):
        materials = surface_tables.upload_materials(np.array(feeds))
        seen.begin(materials)
        seen.add(page(np.ones((4, 4))), ImageFeed("a"), materials, blocks=blocks)
        assert (seen.read()[..., 3] == 1.0).all()
    assert groups == [2 * 4 * 16, 6 * 4 * 16]


def test_samplers_and_images_show_the_same_seed_3(monkeypatch):
    """Software drivers read tables as images, others as samplers."""
    image = np.random.default_rng(3).random((90, 70))
    maps = []
    for as_images in (True, False):
        shader.load.cache_clear()
        monkeypatch.setattr(shader, "reads_images", lambda as_images=as_images: as_images)
        seen = scattered(3, count=3)
        materials = surface_tables.upload_materials(np.array((-1, 1, 0)))
        seen.begin(materials)
        blocks = surface_tables.find_blocks(seen.hits, seen.labels)
        seen.add(page(image, is_srgb=True), ImageFeed("a", mapping=((3, 1, 0), (0, 2, 0))), materials, blocks=blocks)
        maps.append(seen.read())
    shader.load.cache_clear()
    assert np.array_equal(*maps)
    assert len(np.unique(maps[0])) > 1000
