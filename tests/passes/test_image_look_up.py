# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what images show at hits: against closed forms and float64 numpy, with pages larger and smaller than the map."""

import itertools

import numpy as np
import pytest

from addon.core.material_feeds import (
    AVERAGE,
    LUMINANCE,
    LUMINANCE_WEIGHTS,
    AttributeFeed,
    Extension,
    ImageFeed,
    ImagePixels,
    Limits,
)
from addon.passes import shader, surface_tables, surface_values, target
from tests.support.seen_surface import SeenSurface, grid, page

pytestmark = pytest.mark.usefixtures("gpu_context")


EXACT = 2e-6
"""Single precision, of values up to 1; UVs of a few units lose some bits."""
EIGHT_BITS = 1e-6
"""Whole steps of 1/255 are stored exactly."""


def linear(stored):
    """sRGB to scene-linear, IEC 61966-2-1."""
    return np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)


def bilinear(image, u, v, extension, *, closest=False):
    """The image (h, w, 4) at u and v, as Blender interpolates: pixel centers lie at (i + 0.5) / w."""
    height, width = image.shape[:2]

    def at(j, i):
        if extension == Extension.REPEAT:
            return image[j % height, i % width]
        if extension == Extension.MIRROR:
            i, j = (
                np.where(k % (2 * n) < n, k % (2 * n), 2 * n - 1 - k % (2 * n)) for k, n in ((i, width), (j, height))
            )
            return image[j, i]
        inside = (i >= 0) & (i < width) & (j >= 0) & (j < height)
        texels = image[np.clip(j, 0, height - 1), np.clip(i, 0, width - 1)]
        return texels * inside[..., None] if extension == Extension.CLIP else texels

    if closest:
        return at(np.floor(v * height).astype(int), np.floor(u * width).astype(int))
    x, y = u * width - 0.5, v * height - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - i)[..., None], (y - j)[..., None]
    lower, upper = (at(k, i) * (1 - a) + at(k, i + 1) * a for k in (j, j + 1))
    return lower * (1 - b) + upper * b


@pytest.mark.parametrize("extension", Extension)
@pytest.mark.parametrize("is_smooth", [True, False])
@pytest.mark.parametrize("size", [(5, 7), (1, 4)])
def test_each_extension_is_as_in_numpy_seed_1(extension, is_smooth, size):
    image = np.random.default_rng(1).random((*size, 4))
    seen = SeenSurface(grid(2, 3), (96, 96))
    mapping = (2.9, 0.4, -1.23), (-0.3, 3.1, -1.07)
    feed = ImageFeed("a", mapping=mapping, extension=extension, is_smooth=is_smooth)
    shown = seen.shown(page(image), feed)
    u, v = (row[0] * seen.x.astype(float) + row[1] * seen.y + row[2] for row in mapping)
    assert u.min() < -1.0
    assert u.max() > 1.9
    error = np.abs(shown[..., :3] - bilinear(image, u, v, extension, closest=not is_smooth)[..., :3]).max(axis=-1)
    # Single precision puts a few texels on the other side of an edge between pixels.
    assert np.sort(error.ravel())[-3 if not is_smooth else -1] < EXACT * 8
    assert (shown[..., 3] == 1.0).all()


def test_a_linear_ramp_is_exact():
    seen = SeenSurface(grid(4, 4), (64, 64))
    ramp = np.tile((np.arange(32) + 0.5) / 32, (4, 1))
    shown = seen.shown(page(ramp), ImageFeed("a"))
    assert np.abs(shown[..., 0] - seen.x)[:, 1:-1].max() < EXACT


def test_a_page_as_large_as_the_map_comes_back_as_it_is_seed_2():
    """A footprint of one pixel does not blur."""
    image = np.random.default_rng(2).integers(0, 256, (64, 64, 4)) / 255
    image[..., 3] = 1.0
    seen = SeenSurface(grid(5, 3), (64, 64))
    shown = seen.shown(page(image, is_byte=True), ImageFeed("a"))
    assert np.abs(shown - image).max() < EXACT * 10
    shown = seen.shown(page(image, is_byte=True, is_srgb=True), ImageFeed("a"))
    assert np.abs(shown[..., :3] - linear(image[..., :3])).max() < EXACT * 10


def test_all_stored_bytes_are_kept():
    levels = (np.arange(256) / 255).reshape(16, 16)
    seen = SeenSurface(grid(1, 1), (16, 16))
    for is_srgb in (False, True):
        shown = seen.shown(page(levels, is_byte=True, is_srgb=is_srgb), ImageFeed("a", is_smooth=False))[..., 0]
        expected = linear(levels) if is_srgb else levels
        assert np.abs(shown - expected).max() < EIGHT_BITS


def test_srgb_is_interpolated_as_it_is_stored():
    """As in Cycles: halfway between black and white lies the stored value 0.5."""
    seen = SeenSurface(grid(1, 1), (64, 64))
    image = np.tile(np.float32((0.0, 1.0)), (2, 1))
    shown = seen.shown(page(image, is_srgb=True), ImageFeed("a", extension=Extension.EXTEND))[..., 0]
    assert np.abs(shown - linear(np.clip(seen.x.astype(float) * 2.0 - 0.5, 0.0, 1.0))).max() < EXACT


@pytest.mark.parametrize("size", [(75, 70), (129, 131), (517, 1031)])
def test_ramps_of_odd_sizes_are_exact_from_each_level(size):
    """Pixels of a level are equal parts of the image, and their means lie on the ramp at their centers. Parts of a pixel count
    with its whole value, which is off by 1 / (4 n) of a pixel at most, in a level of n."""
    seen = SeenSurface(grid(4, 4), (32, 32))
    u, v = np.meshgrid(*((np.arange(count) + 0.5) / count for count in size))
    shown = seen.shown(page(np.stack([u, v, 0.0 * u], axis=-1)), ImageFeed("a"))
    inner = np.s_[2:-2, 2:-2]  # without the footprints across the border
    for axis, place in enumerate((seen.x, seen.y)):
        sides = [each[axis] for each in surface_tables.level_sizes(*size) if each[axis] >= 32]
        most = sum(1.0 / (4 * (side // 2 + 1) * side) for side in sides if side % 2)
        assert np.abs(shown[..., axis] - place)[inner].max() < most + EXACT * 10


@pytest.mark.parametrize("pixels_a_texel", [37.0, 16.0, 3.3])
def test_a_small_checker_shows_its_mean(pixels_a_texel):
    """The mean of scene-linear colors, without a pattern of its own."""
    image = np.indices((512, 512)).sum(axis=0) % 2
    repeats = 64 * pixels_a_texel / 512
    seen = SeenSurface(grid(7, 5), (64, 64))
    feed = ImageFeed("a", mapping=((repeats, 0.0, 0.21), (0.0, repeats, 0.13)))
    for is_srgb in (False, True):
        shown = seen.shown(page(image, is_srgb=is_srgb, is_byte=True), feed)[..., 0]
        assert np.abs(shown - 0.5).max() < 1e-3


def test_a_checker_comes_back_to_half_a_texel_turned_seed_3():
    """A checker turned on the surface, of fields of 8 texels: each texel within a field, by half a texel, has its color."""
    turn = np.deg2rad(np.random.default_rng(3).uniform(20, 70))
    size, fields = 128, 16
    seen = SeenSurface(grid(9, 11), (size, size))
    row_u = (np.cos(turn), -np.sin(turn), 0.37)
    row_v = (np.sin(turn), np.cos(turn), 0.11)
    image = np.kron(np.indices((fields, fields)).sum(axis=0) % 2, np.ones((8, 8)))
    shown = seen.shown(page(image), ImageFeed("a", mapping=(row_u, row_v)))[..., 0]
    u, v = (row[0] * seen.x.astype(float) + row[1] * seen.y + row[2] for row in (row_u, row_v))
    field = np.floor(u * fields) + np.floor(v * fields)
    to_edge = np.minimum(*(np.abs(w * fields - np.round(w * fields)) for w in (u, v))) * size / fields
    assert np.abs(shown - field % 2)[to_edge > 0.5].max() < 1e-4
    assert (to_edge > 0.5).mean() > 0.7


def brute_means(image, u_of, v_of, size, taps=24):
    """The mean of the repeated image over each texel, from taps x taps places."""
    steps = (np.arange(taps) + 0.5) / taps
    total = np.zeros((size, size))
    for a, b in itertools.product(steps, steps):
        x, y = np.meshgrid((np.arange(size) + a) / size, (np.arange(size) + b) / size)
        i, j = (
            np.floor(w * n).astype(int) % n for w, n in ((u_of(x, y), image.shape[1]), (v_of(x, y), image.shape[0]))
        )
        total += image[j, i]
    return total / taps**2


@pytest.mark.parametrize("seed", range(4, 10))
def test_random_footprints_are_averaged_seeds_4_to_9(seed):
    """Against the mean over each texel's own parallelogram. White noise is the hardest image."""
    rng = np.random.default_rng(seed)
    image = rng.random((200, 150))
    matrix = rng.normal(size=(2, 2)) * rng.uniform(0.5, 3.0)
    mapping = tuple((*row, shift) for row, shift in zip(matrix.tolist(), rng.random(2).tolist(), strict=True))
    seen = SeenSurface(grid(3, 4), (48, 48))
    shown = seen.shown(page(image), ImageFeed("a", mapping=mapping))[..., 0]
    truth = brute_means(image, *(lambda x, y, r=row: r[0] * x + r[1] * y + r[2] for row in mapping), 48)
    noise = np.sqrt(np.mean((truth - 0.5) ** 2))
    error = np.sqrt(np.mean((shown - truth) ** 2))
    point = seen.shown(page(image), ImageFeed("a", mapping=mapping), samples=10**8)[..., 0]
    unfiltered = np.sqrt(np.mean((point - truth) ** 2))
    print(f"seed {seed}: {error:.4f}, noise {noise:.4f}, without a footprint {unfiltered:.4f}")
    assert error < noise
    assert error < 0.5 * unfiltered or unfiltered < 0.1


def test_uneven_footprints_keep_the_detail_across():
    """The image is squeezed along v only: stripes along v stay sharp."""
    image = np.tile(np.indices((64,))[0] % 2, (1024, 1)) * np.random.default_rng(10).uniform(0.5, 1.5, (1024, 1))
    seen = SeenSurface(grid(2, 2), (64, 64))
    shown = seen.shown(page(image), ImageFeed("a"))[..., 0]
    assert shown[:, ::2].max() < 1e-3
    assert np.abs(shown[:, 1::2] - image.reshape(64, 16, 64).mean(axis=1)[:, 1::2]).max() < 0.02


@pytest.mark.parametrize("samples", [1, 16])
def test_seams_do_not_blur_seed_11(samples):
    """UVs of each triangle jump by whole pages: the same picture. Footprints are 3 pixels, so a jump would be seen."""
    rng = np.random.default_rng(11)
    triangles = grid(23, 19)
    image = np.kron(rng.random((32, 32)), np.ones((6, 6)))
    jumps = rng.integers(-3, 4, (len(triangles), 1, 2))
    shown = [
        SeenSurface(triangles, (64, 64), uv=triangles[..., :2] + shift).shown(
            page(image), ImageFeed("a"), samples=samples
        )
        for shift in (np.zeros((1, 1, 2)), jumps)
    ]
    assert np.abs(shown[0] - shown[1]).max() < 1e-4


def test_a_border_to_a_coarser_part_does_not_alias_seed_14():
    """Left of the middle the page hardly moves. The texels right of it have 16 pixels each, and aligned ones."""
    image = np.random.default_rng(14).random((512, 512))
    triangles = grid(2, 1)
    uv = triangles[..., :2].copy()
    left = triangles.mean(axis=1)[:, 0] < 0.5
    uv[left, :, 0] = 0.5 + (uv[left, :, 0] - 0.5) * 0.001
    shown = SeenSurface(triangles, (32, 32), uv=uv).shown(page(image), ImageFeed("a"))[..., 0]
    truth = image.reshape(32, 16, 32, 16).mean(axis=(1, 3))
    assert np.abs(shown - truth)[:, 16:].max() < 1e-4


def test_neighbors_of_another_material_tell_nothing_seed_15():
    """Columns of two materials, one texel wide each, that show the same place at the same height."""
    image = np.random.default_rng(15).random((512, 512))
    triangles = grid(32, 1)
    second = np.floor(triangles.mean(axis=1)[:, 0] * 32).astype(int) % 2 == 1
    uv = triangles[..., :2].copy()
    uv[second, :, 0] -= 1 / 32
    seen = SeenSurface(triangles, (32, 32), uv=uv, materials=1 + second)
    shown = seen.shown(page(image), ImageFeed("a"))[..., 0]
    truth = image.reshape(32, 16, 32, 16).mean(axis=(1, 3))
    assert np.abs(shown - truth)[:, ::2].max() < 1e-4


def test_a_step_in_depth_tells_nothing_seed_17():
    """A slope of two halves, one far above the other. Their UVs are whole pages apart: the same picture."""
    image = np.random.default_rng(17).random((512, 512))
    triangles = grid(8, 8, height=lambda x, y: 2.0 * x)
    uv = triangles[..., :2].copy()
    right = triangles.mean(axis=1)[:, 0] > 0.5
    triangles[right, :, 2] += 3.0
    uv[right, :, 0] += 3.0
    shown = SeenSurface(triangles, (32, 32), uv=uv).shown(page(image), ImageFeed("a"))[..., 0]
    truth = image.reshape(32, 16, 32, 16).mean(axis=(1, 3))
    assert np.abs(shown - truth).max() < 1e-4


def test_holes_on_one_side_keep_the_footprint_seed_16():
    """Every other column or row is missing: each texel has no neighbor along one axis."""
    image = np.random.default_rng(16).random((512, 512))
    truth = image.reshape(32, 16, 32, 16).mean(axis=(1, 3))
    triangles = grid(32, 32)
    column, row = np.floor(triangles.mean(axis=1)[:, :2] * 32).astype(int).T
    for keep in (column % 2 == 0, row % 2 == 0):
        seen = SeenSurface(triangles[keep], (32, 32))
        shown = seen.shown(page(image), ImageFeed("a"))
        is_hit = shown[..., 3] == 1.0
        assert is_hit.mean() == 0.5
        assert np.abs(shown[..., 0] - truth)[is_hit].max() < 1e-4


def test_only_hits_in_the_tile_count():
    triangles = grid(2, 2)
    seen = SeenSurface(triangles, (64, 64), uv=triangles[..., :2] * 2.0 + (1.0, 0.0))
    materials = surface_tables.upload_materials(np.ones(2))
    seen.begin(materials)
    tiles = {1002: 0.2, 1003: 0.4, 1012: 0.6}
    feed = ImageFeed("a", tiles=tuple(tiles))
    for tile, value in tiles.items():
        seen.add(page(np.full((4, 4), value)), feed, materials, tile=tile)
    sums = seen.read()
    expected = np.zeros((64, 64))
    expected[:32, :32], expected[:32, 32:], expected[32:, :32] = tiles.values()
    assert np.abs(sums[..., 0] - expected).max() < EXACT
    assert np.array_equal(sums[..., 3], expected > 0)


def test_the_pixels_at_a_tiles_border_do_not_wrap():
    seen = SeenSurface(grid(1, 1), (64, 64))
    image = np.tile(np.float32((0.0, 0.0, 0.0, 1.0)), (4, 1))
    assert seen.shown(page(image), ImageFeed("a", tiles=(1001,)), tile=1001)[:, :8, 0].max() == 0.0
    assert seen.shown(page(image), ImageFeed("a"))[:, :8, 0].max() > 0.1


def test_each_hit_counts_once_over_all_feeds():
    """Four materials: an image, another image, a constant, and one that the map cannot show.

    A hole is a miss, and what is outside the low mesh is not.
    """
    triangles = grid(4, 4)
    centers = triangles.mean(axis=1)
    numbers = 1 + (centers[:, 0] > 0.5) + 2 * (centers[:, 1] > 0.5)
    keep = ~((centers[:, 0] < 0.25) & (centers[:, 1] < 0.25))
    is_low = np.ones((64, 64))
    is_low[:, -4:] = 0.0
    seen = SeenSurface(triangles[keep], (64, 64), materials=numbers[keep], is_low=is_low)
    materials = surface_tables.upload_materials(np.array([0, 1, 2, 0, -1]), np.outer((0, 0, 0, 7, 0), (1, 2, 3)))
    for number, offset in enumerate(((-0.25, -0.25), (0.25, 0.25))):
        seen.probe(offset)
        seen.begin(materials, is_first=number == 0)
        for feed, value in ((1, 0.3), (2, 0.6)):
            seen.add(page(np.full((8, 8), value)), ImageFeed("a"), materials, feed)
    means = seen.means()
    sums = seen.read()
    assert np.allclose(sums[:16, :16, 3], 2 / 256)
    assert (means[:16, :16, 3] == -1.0).all()
    assert (sums[:, -4:] == 0.0).all()
    assert np.allclose(means[:32, 33:-4], (0.6, 0.6, 0.6, 1.0))
    assert np.allclose(means[:31, 17:32], (0.3, 0.3, 0.3, 1.0))
    assert np.allclose(means[33:, :31], (7, 14, 21, 1))
    assert (sums[33:, 33:] == 0.0).all()


@pytest.mark.parametrize(
    ("channel", "weights"),
    [
        (0, (1, 0, 0, 0)),
        (2, (0, 0, 1, 0)),
        (3, (0, 0, 0, 1)),
        (1, (0, 1, 0, 0)),
        (LUMINANCE, (*LUMINANCE_WEIGHTS, 0)),
        (AVERAGE, (1 / 3, 1 / 3, 1 / 3, 0)),
    ],
)
def test_channels_scale_and_offset(channel, weights):
    color = np.array((0.2, 0.5, 0.9, 0.4))
    seen = SeenSurface(grid(1, 1), (8, 8))
    feed = ImageFeed("a", channel=channel, scale=(2.0, -1.0, 0.5), offset=(0.1, 0.2, 0.3))
    shown = seen.shown(page(np.broadcast_to(color, (4, 4, 4))), feed)[..., :3]
    assert np.allclose(shown, color @ np.array(weights) * np.array(feed.scale) + feed.offset, atol=EXACT)


@pytest.mark.parametrize("pixels", [4, 512])
def test_transparent_pixels_do_not_color_their_neighbors(pixels):
    """Red, and green that is fully transparent, in stripes: all is red where anything shows."""
    image = np.zeros((pixels, pixels, 4))
    image[:, ::2] = 1, 0, 0, 1
    image[:, 1::2] = 0, 1, 0, 0
    seen = SeenSurface(grid(1, 1), (64, 64))
    shown = seen.shown(page(image, weighs_alpha=True), ImageFeed("a"))
    # In the very middle of a green pixel nothing else shows.
    assert np.median(shown[..., 0]) == pytest.approx(1.0, abs=1e-5)
    assert shown[..., 1].max() < 1e-5
    assert seen.shown(page(image), ImageFeed("a"))[..., 1].max() > 0.45
    alpha = seen.shown(page(image, weighs_alpha=True), ImageFeed("a", channel=3))[..., 0]
    assert alpha.mean() == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("pixels_a_texel", [0.1, 4.0])
def test_colors_of_srgb_count_by_alpha_seed_13(pixels_a_texel):
    """Where pixels are large, stored colors count by alpha, and become linear afterwards; where they are small, linear ones."""
    rng = np.random.default_rng(13)
    size, count = 32, max(3, round(32 * pixels_a_texel))
    image = rng.random((count, count, 4))
    seen = SeenSurface(grid(1, 1), (size, size))
    stored = page(image, is_srgb=True, weighs_alpha=True)
    shown = seen.shown(stored, ImageFeed("a", extension=Extension.EXTEND))[..., :3]
    alpha = image[..., 3:]
    if pixels_a_texel < 1.0:
        u, v = seen.x.astype(float), seen.y.astype(float)
        weighed = bilinear(np.concatenate([image[..., :3] * alpha, alpha], -1), u, v, Extension.EXTEND)
        assert np.abs(shown - linear(weighed[..., :3] / weighed[..., 3:])).max() < EXACT * 10
        return
    weighed = np.concatenate([linear(image[..., :3]) * alpha, alpha], -1).reshape(size, 4, size, 4, 4).mean(axis=(1, 3))
    assert np.abs(shown - weighed[..., :3] / weighed[..., 3:]).max() < EXACT * 10


def test_several_samples_average_what_one_would_seed_12():
    """Each sample covers its share of the texel: the mean of 16 is as sharp as one with the whole footprint, or sharper."""
    image = np.random.default_rng(12).random((256, 256))
    seen = SeenSurface(grid(2, 2), (32, 32))
    materials = surface_tables.upload_materials(np.ones(2))
    offsets = [((i + 0.5) / 4 - 0.5, (j + 0.5) / 4 - 0.5) for i in range(4) for j in range(4)]
    for number, offset in enumerate(offsets):
        seen.probe(offset)
        seen.begin(materials, is_first=number == 0)
        seen.add(page(image), ImageFeed("a"), materials, samples=16)
    truth = image.reshape(32, 8, 32, 8).mean(axis=(1, 3))
    assert np.abs(seen.means()[..., 0] - truth).max() < 1e-4


def test_a_texel_without_neighbors_shows_the_page():
    """One triangle that only one ray hits."""
    triangle = [[(0.5, 0.5, 0), (0.52, 0.5, 0), (0.5, 0.52, 0)]]
    seen = SeenSurface(triangle, (64, 64))
    shown = seen.shown(page(np.full((512, 512), 0.25)), ImageFeed("a"))
    assert np.count_nonzero(shown[..., 3] == 1.0) == 1
    assert shown[..., 0].max() == np.float32(0.25)


def test_limits_count_before_scale_and_offset_seed_14():
    color = np.random.default_rng(14).uniform(-2.0, 3.0, (4, 4, 4))
    seen = SeenSurface(grid(1, 1), (4, 4))
    scale, offset, low, high = (2.0, -1.0, 0.5), (0.1, 0.2, 0.3), (0.0, -1.0, -np.inf), (1.0, np.inf, 0.7)
    feed = ImageFeed("a", scale=scale, offset=offset, limits=Limits(low, high), is_smooth=False)
    shown = seen.shown(page(color), feed)[..., :3]
    assert np.abs(shown - (color[..., :3].clip(low, high) * scale + offset)).max() < EXACT
    for channel, weights in ((LUMINANCE, LUMINANCE_WEIGHTS), (AVERAGE, (1 / 3, 1 / 3, 1 / 3))):
        feed = ImageFeed("a", channel=channel, limits=Limits((0.1,) * 3, (0.8,) * 3, -1.0, 1.5), is_smooth=False)
        number = (color[..., :3].clip(-1.0, 1.5) @ np.array(weights)).clip(0.1, 0.8)
        assert np.abs(seen.shown(page(color), feed)[..., 0] - number).max() < EXACT


# Image page


SINGLE = 1e-6


def mean_over_parts(values, count):
    """The means (count, ...) of equal parts of the first axis, with shares of the values that a border cuts."""
    size = len(values)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.arange(count + 1) * size / count
    whole = np.minimum(np.floor(at).astype(int), size - 1)
    sums = total[whole] + values[whole] * (at - whole).reshape(-1, *[1] * (values.ndim - 1))
    return np.diff(sums, axis=0) * count / size


def test_parts_of_the_oracle():
    assert np.allclose(mean_over_parts(np.arange(6.0), 3), (0.5, 2.5, 4.5))
    assert np.allclose(mean_over_parts(np.array((0.0, 1.0, 5.0)), 2), (1 / 3, 11 / 3))


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (1, 7), (2, 1), (64, 64), (37, 100), (255, 129)])
@pytest.mark.parametrize("is_byte", [False, True])
def test_each_level_has_the_means_of_its_parts_seed_1(size, is_byte):
    """Odd sizes shift nothing: each pixel is an equal part of the level before, all of which it covers."""
    values = np.random.default_rng(1).integers(0, 256, (*size, 4)).astype(np.float32) / np.float32(255)
    page = surface_tables.upload_image(ImagePixels(values, is_byte=is_byte))
    sizes = surface_tables.level_sizes(size[1], size[0])
    assert sizes[-1] == (1, 1)
    assert page.top == len(sizes) - 1
    levels = np.array(page.levels.read()).reshape(page.levels.height, page.levels.width, 4)
    truth = values.astype(np.float64)
    used = np.zeros(levels.shape[:2], int)
    for level, (width, height) in enumerate(sizes[1:], 1):
        x, y = surface_tables.level_origin(sizes, level)
        assert x + width <= levels.shape[1]
        assert y + height <= levels.shape[0]
        used[y : y + height, x : x + width] += 1
        truth = mean_over_parts(mean_over_parts(truth, height).swapaxes(0, 1), width).swapaxes(0, 1)
        assert np.abs(levels[y : y + height, x : x + width] - truth).max() < SINGLE
    assert used.max() <= 1


@pytest.mark.usefixtures("gpu_context")
def test_colors_are_averaged_in_linear_light():
    values = np.zeros((2, 2, 4), np.float32)
    values[0, :, :3], values[1, :, 3] = 1.0, 1.0
    for weighs_alpha, expected in ((False, (0.5, 0.5, 0.5, 0.5)), (True, (0.0, 0.0, 0.0, 0.5))):
        page = surface_tables.upload_image(ImagePixels(values, is_srgb=True, is_byte=True, weighs_alpha=weighs_alpha))
        assert np.allclose(np.array(page.levels.read()).ravel(), expected)


@pytest.mark.usefixtures("gpu_context")
def test_values_that_are_not_finite_do_not_spread():
    values = np.full((8, 8, 4), 0.5, np.float32)
    values[0, 0], values[7, 7] = np.nan, np.inf
    page = surface_tables.upload_image(ImagePixels(values))
    levels = np.array(page.levels.read()).reshape(page.levels.height, page.levels.width, 4)
    assert np.isfinite(np.array(page.pixels.read())).all()
    sizes = surface_tables.level_sizes(8, 8)
    for level, (width, height) in enumerate(sizes[1:], 1):  # between levels, nothing is written
        x, y = surface_tables.level_origin(sizes, level)
        assert np.isfinite(levels[y : y + height, x : x + width]).all()
    assert np.isnan(values[0, 0]).all()  # the caller's pixels stay
    assert levels[0, 0, 0] == np.float32(0.375)
    assert (levels[1:3, 1:3] == 0.5).all()


def test_an_image_that_is_too_large_is_reduced():
    values = np.random.default_rng(2).random((7, 10, 4), np.float32)
    assert surface_tables.fitting(values, 10)[0] is values
    reduced, parts = surface_tables.fitting(values, 4)
    assert parts == 3
    assert reduced.shape == (3, 4, 4)
    assert np.allclose(reduced[0, 0], values[:3, :3].mean(axis=(0, 1)))
    assert np.allclose(reduced[2, 3], values[6:, 9:].mean(axis=(0, 1)))


def test_an_image_without_pixels_is_refused():
    with pytest.raises(ValueError, match="no pixels"):
        surface_tables.upload_image(ImagePixels(np.zeros((0, 5, 4), np.float32)))


@pytest.mark.usefixtures("gpu_context")
def test_a_very_wide_image_has_all_its_levels():
    values = np.zeros((3, 16384, 4), np.float32)
    values[:, ::2] = 1.0
    page = surface_tables.upload_image(ImagePixels(values, is_byte=True))
    assert page.top == 14
    assert page.levels.width == 8192
    x, y = surface_tables.level_origin(surface_tables.level_sizes(16384, 3), 14)
    levels = np.array(page.levels.read()).reshape(page.levels.height, page.levels.width, 4)
    assert np.allclose(levels[y, x], 0.5, atol=SINGLE)


# Plain values


EXACT_VALUES = 1e-5


def shown(seen, values, feed, materials):
    seen.begin(materials)
    table = surface_tables.upload_values(np.asarray(values, np.float32), seen.corners)
    surface_values.add_attribute(seen.sums, seen.hits, table, feed, 1, labels=seen.labels, materials=materials)
    return seen.read()


def test_attributes_are_interpolated_in_each_triangle_seed_1():
    """Values that jump at each edge: an attribute of any domain, by corner."""
    rng = np.random.default_rng(1)
    triangles = grid(4, 5)
    values = rng.random((len(triangles), 3, 4))
    seen = SeenSurface(triangles, (64, 64))
    sums = shown(seen, values.reshape(-1, 4), AttributeFeed("a"), surface_tables.upload_materials(np.ones(2)))
    points = np.stack([seen.x, seen.y], axis=-1).reshape(-1, 1, 2).astype(float)
    a, b, c = (triangles[None, :, i, :2] for i in range(3))

    def area(p, q, r):
        return (q - p)[..., 0] * (r - p)[..., 1] - (q - p)[..., 1] * (r - p)[..., 0]

    weights = np.stack([area(b, c, points), area(c, a, points), area(a, b, points)], -1) / area(a, b, c)[..., None]
    inside = weights.min(axis=-1)
    found = inside.argmax(axis=1)
    clear = inside.max(axis=1) > 1e-4  # a texel on an edge may show either triangle
    picked = np.arange(len(found))
    truth = np.einsum("nk,nkc->nc", weights[picked, found], values[found])
    assert clear.mean() > 0.9
    assert np.abs(sums.reshape(-1, 4)[clear, :3] - truth[clear, :3]).max() < EXACT_VALUES
    assert (sums[..., 3] == 1.0).all()


@pytest.mark.parametrize(
    ("value", "channel", "expected"),
    [
        ((0.25,), None, (0.25, 0.25, 0.25)),
        ((0.25, 0.5), None, (0.25, 0.5, 0.0)),
        ((0.25, 0.5, 0.75), 1, (0.5, 0.5, 0.5)),
        ((0.25, 0.5, 0.75), 3, (1.0, 1.0, 1.0)),
        ((0.25, 0.5, 0.75, 0.1), 3, (0.1, 0.1, 0.1)),
        ((1.0, 0.0, 0.0), LUMINANCE, (0.212639, 0.212639, 0.212639)),
    ],
)
def test_attributes_have_one_to_four_channels(value, channel, expected):
    triangles = grid(1, 1)
    seen = SeenSurface(triangles, (8, 8))
    feed = AttributeFeed("a", channel, (2.0, 2.0, 2.0), (0.5, 0.0, 0.0))
    sums = shown(seen, np.broadcast_to(value, (6, len(value))), feed, surface_tables.upload_materials(np.ones(2)))
    assert np.allclose(sums[..., :3], np.array(expected) * 2.0 + (0.5, 0.0, 0.0))


def test_limits_count_at_the_hit_before_scale_and_offset_seed_2():
    """What is interpolated is limited, and not the corners."""
    values = np.random.default_rng(2).uniform(-2.0, 3.0, (6, 3))
    limits = Limits((0.2, 0.0, -1.0), (0.9, 1.0, 5.0))
    triangles = grid(1, 1)
    seen = SeenSurface(triangles, (32, 32))
    free, limited = (
        shown(seen, values, AttributeFeed("a", limits=found), surface_tables.upload_materials(np.ones(2)))[..., :3]
        for found in (Limits(), limits)
    )
    assert free.min() < -1.0
    assert np.array_equal(limited, free.clip(np.float32(limits.low), np.float32(limits.high)))
    luminance = AttributeFeed("a", LUMINANCE, limits=Limits(least=0.0, most=1.0))
    found = shown(seen, values, luminance, surface_tables.upload_materials(np.ones(2)))[..., 0]
    assert np.abs(found - free.clip(0.0, 1.0) @ np.array(LUMINANCE_WEIGHTS)).max() < EXACT_VALUES


def test_only_materials_of_the_feed_show_the_attribute():
    triangles = grid(2, 2)
    seen = SeenSurface(triangles, (8, 8), materials=1 + (triangles.mean(axis=1)[:, 0] > 0.5))
    sums = shown(seen, np.ones((24, 3)), AttributeFeed("a"), surface_tables.upload_materials(np.array([0, 1, 2])))
    assert (sums[:, :4] == 1.0).all()
    assert (sums[:, 4:] == 0.0).all()


# Served blocks


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
