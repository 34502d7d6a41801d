# SPDX-License-Identifier: GPL-3.0-or-later
"""The margin around islands: nearest texels, continuation across seams, and its effect on mip levels."""

import cmath
from dataclasses import replace

import bpy
import gpu
import numpy as np
import pytest

from addon.core.map_types import MARGIN, MISSED, WRITTEN
from addon.core.settings import Settings
from addon.engine import bands, margins
from addon.jobs import Job, bake_all
from addon.mesh.triangle_mesh import Mesh
from addon.passes import margin_fill
from tests.support import angles, maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 216, 160
BLUR = 0.25
"""Degrees. The field changes by this much over half a texel: the mean of the texels around a position may be off by it."""


def finished(values, lows, tile=1001, name="NORMAL", **settings):
    """The texels (H, W, 4) and their state (H, W) of `values` (H, W, 4), drawn in bands as a bake does."""
    height, width = values.shape[:2]
    settings = Settings(width=width, height=height, **{"maps": () if name == "NORMAL" else (name,), **settings})
    last = margins.for_maps(lows, settings)[name]
    texels, state = np.empty((height, width, 4), np.float32), np.empty((height, width), np.uint8)
    for part in bands.bands(width, height, settings.sampling.margin, tile):
        rows = np.zeros((part.height, width, 4), np.float32)
        first, stop = max(0, part.start - part.halo), min(height, part.stop + part.halo)
        rows[first - part.start + part.halo : stop - part.start + part.halo] = values[first:stop]
        stored = last.draw(part, upload(rows))
        stored.read(texels[part.start : part.stop])
        stored.read(state[part.start : part.stop], slot=1)
    last.complete(tile, texels, state)
    return texels, state


def upload(values):
    """A texture of `values` (H, W, 4)."""
    data = gpu.types.Buffer("FLOAT", values.shape, values)
    return gpu.types.GPUTexture(values.shape[1::-1], format="RGBA32F", data=data)


def marked(alpha):
    """Values (H, W, 4) of this alpha that are their own column and row, for a map that stores them unchanged."""
    rows, columns = np.indices(alpha.shape)
    return np.stack([columns, rows, np.zeros_like(rows), alpha], axis=-1).astype(np.float32)


def squares(values, texels):
    """The squared distance (H, W) from each texel to the texel whose value it has, and to the nearest written one."""
    rows, columns = np.indices(values.shape[:2])
    y, x = np.nonzero(values[..., 3] > 0.0)
    truth = ((rows[..., None] - y) ** 2 + (columns[..., None] - x) ** 2).min(axis=-1)
    return (texels[..., 0] - columns) ** 2 + (texels[..., 1] - rows) ** 2, truth


# Margin of the nearest texels


def test_texels_between_two_islands_take_the_nearer_one():
    values = np.zeros((40, 46, 4), np.float32)
    values[10:30, 5:20], values[10:30, 26:41] = (0, 0, 1, 1), (0.6, 0, 0.8, 1)
    texels, state = finished(values, [], margin=None)
    assert ((state == WRITTEN) == (values[..., 3] > 0.0)).all()
    assert ((state == MARGIN) == (values[..., 3] == 0.0)).all()
    assert (texels[..., 3] == 1.0).all()
    assert np.allclose(texels[:, :23, :3], (0.5, 0.5, 1.0))
    assert np.allclose(texels[:, 23:, :3], (0.8, 0.5, 0.9))


@pytest.mark.parametrize("level", [0, 1, 2, 3, 4, None])
@pytest.mark.parametrize("seed", [1, 2])
def test_no_background_reaches_a_covered_texel_of_smaller_maps_seed(seed, level):
    """With a margin of 2^level: up to that mip level. With an unlimited margin: on all levels."""
    size = 64
    alpha = (np.random.default_rng(seed).random((size, size)) < 0.004).astype(np.float32)
    alpha[13:22, 40:60] = 1.0  # an island, and specks
    values = np.where(alpha[..., None] > 0.0, np.float32((0.6, 0, 0.8, 1)), np.float32(0.0))
    texels, _ = finished(values, [], margin=None if level is None else 2**level)
    covered = alpha > 0.0
    for _ in range(7 if level is None else level + 1):
        assert (texels[covered][:, 3] == 1.0).all()
        assert np.allclose(texels[covered][:, :3], (0.8, 0.5, 0.9), atol=1e-6)
        side = len(texels) // 2
        if side:
            texels = texels.reshape(side, 2, side, 2, 4).mean(axis=(1, 3))
            covered = covered.reshape(side, 2, side, 2).any(axis=(1, 3))
    assert level not in (1, 2, 3) or (texels[covered][:, 3] < 1.0).any()  # no wider than it was asked for


def test_an_atlas_of_two_objects_has_no_margin_over_the_others_texels():
    def plate(name, left, right, slope):
        """A low and a high square. The low one's UVs fill the map from left to right."""
        corners = [(left, 0.25), (right, 0.25), (right, 0.75), (left, 0.75)]
        points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
        low = zoo.build(name, points, [(0, 1, 2, 3)], [corners])
        return Job(low, [zoo.plane(f"{name} high", slope=slope)])

    # 6 texels apart.
    jobs = [plate("a", 8 / 64, 29 / 64, 0.2), plate("b", 35 / 64, 56 / 64, -0.2)]
    settings = {"method": "CAST", "space": "WORLD", "extrusion": 0.5, "max_distance": 1.0}
    settings |= {"depth": 32, "storage": "MEMORY", "material": False}
    for margin_type in ("EXTEND", "ADJACENT_FACES"):
        atlas_settings = Settings(
            width=64, height=32, image=f"atlas {margin_type}", margin=None, margin_type=margin_type, **settings
        )
        bake_all(bpy.context, jobs, atlas_settings, share_image=True)
        texels = maps.pixels(bpy.data.images[atlas_settings.storing.image])
        assert (texels[..., 3] == 1.0).all()
        x = texels[..., 0] - 0.5
        assert (x[:, :32] < -0.05).all()
        assert (x[:, 32:] > 0.05).all()
        for job in jobs:
            alone = maps.bake(job.low, *job.highs, image="alone", size=(64, 32), **settings)
            written = alone[..., 3] > 0.0
            assert np.count_nonzero(written) == 21 * 16
            assert np.array_equal(texels[written], alone[written])


# Bands


@pytest.fixture
def in_bands(monkeypatch):
    """Treat small maps as large ones, with bands of a few rows, a short reach and short walks across seams."""

    def shrink(rows, reach):
        monkeypatch.setattr(bands, "BAND_TEXELS", SIZE[0] * rows)
        monkeypatch.setattr(bands, "REACH", reach)
        monkeypatch.setattr(margins, "REACH", reach)
        monkeypatch.setattr(margins, "ROWS", 33)
        monkeypatch.setattr(margin_fill, "FARTHEST_ACROSS", 26)

    return shrink


@pytest.mark.parametrize("name", ["as it was", "37 degrees", "mirrored at 127 degrees", "smaller"])
@pytest.mark.parametrize("margin_type", ["EXTEND", "ADJACENT_FACES"])
def test_bands_give_the_same_map_as_the_whole(in_bands, margin_type, name):
    islands = cut(**CUTS[name])
    lows, values = [mesh_of(islands)], drawn(islands, "TANGENT")
    values[60:70, 45:50, 3] = -1.0  # a hole
    whole, whole_state = finished(values, lows, margin=16, margin_type=margin_type)
    in_bands(30, 64)
    texels, state = finished(values, lows, margin=16, margin_type=margin_type)
    assert np.array_equal(state, whole_state)
    assert np.count_nonzero(state == MARGIN) > 1000
    if margin_type == "EXTEND":
        assert np.array_equal(texels, whole)
    else:
        # A position between two texels may be rounded either way.
        off = np.abs(texels - whole).max(axis=-1) > 1e-5
        assert np.count_nonzero(off) < 1e-3 * np.count_nonzero(state == MARGIN)


@pytest.mark.parametrize("margin", [20, None])
@pytest.mark.parametrize("seed", [1, 2])
def test_texels_far_from_a_band_take_almost_the_nearest_texel_seed(in_bands, seed, margin):
    alpha = np.random.default_rng(seed).choice([0.0, 1.0, -1.0], SIZE[::-1], p=[0.9979, 0.0005, 0.0016])
    values = marked(alpha)
    in_bands(30, 8)
    texels, state = finished(values, [], name="POSITION", margin=margin)
    taken, nearest = squares(values, texels)
    assert np.array_equal(state == WRITTEN, alpha > 0.0)
    assert np.array_equal(state == MISSED, alpha < 0.0)
    filled = state == MARGIN
    if margin is None:
        assert filled[alpha == 0.0].all()
    assert np.array_equal(taken[filled & (nearest <= 64)], nearest[filled & (nearest <= 64)])
    slack = 2.0 * np.sqrt(2.0) * margins.COARSE
    assert (np.sqrt(taken[filled]) <= np.sqrt(nearest[filled]) + slack).all()
    if margin is not None:
        assert np.sqrt(nearest[filled].max()) <= margin * np.sqrt(2.0) + slack
        assert filled[(alpha == 0.0) & (nearest <= (margin - slack) ** 2)].all()


# A plane, cut along x = 0


class Island:
    """A rectangle of the plane, x and y from `low` to `high`. It is mapped by uv = scale * rotation * z + offset.

    z = x + y i, or its conjugate if the island is mirrored. UVs are in texels of SIZE.
    """

    def __init__(self, low, high, *, center, scale, degrees, mirrored=False):
        self.low, self.high, self.mirrored = complex(*low), complex(*high), mirrored
        self.factor = scale * cmath.exp(1j * np.radians(degrees))
        self.offset = complex(*center) - self.factor * self._turned((self.low + self.high) / 2)

    def _turned(self, z):
        return np.conj(z) if self.mirrored else z

    def place(self, z):
        """The positions on the map of points of the plane."""
        return self.factor * self._turned(np.asarray(z)) + self.offset

    def point(self, place):
        """The points of the plane at positions on the map, also outside the island."""
        return self._turned((np.asarray(place) - self.offset) / self.factor)

    @property
    def tangent(self):
        """The direction in the plane along which u grows."""
        return self._turned(self.factor.conjugate() / abs(self.factor))

    @property
    def bitangent(self):
        """The direction in the plane along which v grows."""
        return self._turned(1j * self.factor.conjugate() / abs(self.factor))

    def is_over(self, place, rim=0.0):
        """Which positions are on the island, at least `rim` inside, in units of the plane."""
        z = self.point(place)
        return (
            (z.real >= self.low.real + rim)
            & (z.real <= self.high.real - rim)
            & (z.imag >= self.low.imag + rim)
            & (z.imag <= self.high.imag - rim)
        )


def places(size=SIZE):
    """The centers (H, W) of texels, in texels."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    return x + 1j * y


def mesh_of(islands, size=SIZE, *, parted=False):
    """The islands as one mesh. Rectangles share vertices at the same points, unless `parted`."""
    corners = np.array(
        [(i.low, complex(i.high.real, i.low.imag), i.high, complex(i.low.real, i.high.imag)) for i in islands]
    )
    uv = np.array([island.place(z) for island, z in zip(islands, corners, strict=True)])
    z, vertices = np.unique(corners.ravel(), return_inverse=True)
    if parted:
        z, vertices = corners.ravel(), np.arange(corners.size)
    return Mesh(
        name="plane",
        positions=np.stack([z.real, z.imag, np.zeros(len(z))], axis=1).astype(np.float32),
        vertices=vertices.astype(np.int32).ravel(),
        normals=np.tile(np.float32((0, 0, 1)), (corners.size, 1)),
        triangles=(np.array([(0, 1, 2), (0, 2, 3)]) + 4 * np.arange(len(islands))[:, None, None])
        .reshape(-1, 3)
        .astype(np.int32),
        to_world=np.eye(4),
        uv=(np.stack([uv.real, uv.imag], axis=-1) / size).reshape(-1, 2).astype(np.float32),
    )


def field(z):
    """Unit normals (…, 3) over the plane: oblique, and different everywhere."""
    normals = np.stack(
        [0.5 + 0.3 * np.sin(2.0 * z.imag), 0.2 - 0.4 * z.real + 0.2 * np.cos(z.imag), np.ones(z.shape)], axis=-1
    )
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def seen_from(island, place, space):
    """The field of `island` at positions on the map, also outside the island: (H, W, 3)."""
    normals = field(island.point(place))
    if space != "TANGENT":
        return normals
    flat = normals[..., 0] + 1j * normals[..., 1]
    x, y = ((flat * np.conj(axis)).real for axis in (island.tangent, island.bitangent))
    return np.stack([x, y, normals[..., 2]], axis=-1)


def drawn(islands, space, size=SIZE):
    """The map (H, W, 4) of the field without a margin, as PostProcess takes it."""
    place = places(size)
    values = np.zeros((*place.shape, 4), np.float32)
    for island in islands:
        over = island.is_over(place)
        values[over, :3], values[over, 3] = seen_from(island, place, space)[over], 1.0
    return values


CUTS = {
    "as it was": {"degrees": 0.0},
    "a quarter": {"degrees": 90.0},
    "37 degrees": {"degrees": 37.0},
    "mirrored": {"degrees": 0.0, "mirrored": True},
    "mirrored at 127 degrees": {"degrees": 127.0, "mirrored": True},
    "smaller": {"degrees": -20.0, "scale": 28.0},
}


def cut(scale=45.0, **right):
    """The two halves of the plane: the left one unchanged, the right one rotated."""
    return [
        Island((-1, -1), (0, 1), center=(48, 80), scale=45.0, degrees=0.0),
        Island((0, -1), (1, 1), center=(150, 80), scale=scale, **right),
    ]


@pytest.mark.parametrize(
    ("space", "parted"), [("TANGENT", False), ("TANGENT", True), ("OBJECT", True), ("WORLD", False)]
)
@pytest.mark.parametrize("name", CUTS)
def test_surface_continues_across_a_seam(name, space, parted):
    islands, place = cut(**CUTS[name]), places()
    values = drawn(islands, space)
    texels, state = finished(
        values, [mesh_of(islands, parted=parted)], space=space, margin=16, margin_type="ADJACENT_FACES"
    )
    plain, plain_state = finished(values, [mesh_of(islands)], space=space, margin=16)
    assert np.array_equal(state, plain_state)
    assert np.array_equal(texels[state != MARGIN], plain[state != MARGIN])
    for island, neighbor in (islands, islands[::-1]):
        z = island.point(place)
        # Beside the seam, away from its ends and from the margin of the other island.
        beside = (
            (state == MARGIN)
            & (np.abs(z.imag) < 0.8)
            & (np.sign(z.real) == -np.sign(island.low.real + island.high.real))
        )
        beside &= (np.abs(z.real) * abs(island.factor) < 12.0) & ~neighbor.is_over(place, -0.3)
        assert np.count_nonzero(beside) > 500
        error = angles.degrees(angles.decode(texels), seen_from(island, place, space))[beside]
        assert error.max() < BLUR
        assert angles.degrees(angles.decode(plain), seen_from(island, place, space))[beside].max() > 3.0


@pytest.mark.parametrize("name", CUTS)
def test_vectors_along_the_surface_turn_at_a_seam(name):
    """As normals in tangent space, in another order and of any length."""
    islands, place = cut(**CUTS[name]), places()
    values = drawn(islands, "TANGENT")
    values[..., :3] = 3.0 * values[..., [0, 2, 1]]
    options = {"name": "DISPLACEMENT", "margin": 16, "margin_type": "ADJACENT_FACES"}
    texels, state = finished(values, [mesh_of(islands)], tangent_displacement=True, **options)
    for island, neighbor in (islands, islands[::-1]):
        z = island.point(place)
        beside = (state == MARGIN) & (np.abs(z.imag) < 0.8) & ~neighbor.is_over(place, -0.3)
        beside &= (np.sign(z.real) == -np.sign(island.low.real + island.high.real)) & (
            np.abs(z.real) * abs(island.factor) < 12.0
        )
        assert np.count_nonzero(beside) > 500
        truth = 3.0 * seen_from(island, place, "TANGENT")[..., [0, 2, 1]]
        assert np.abs(texels[..., :3] - truth)[beside].max() < 3.0 * np.radians(BLUR)


def test_nearest_texel_stays_where_the_surface_ends():
    islands, place = cut(degrees=37.0), places()
    values, lows = drawn(islands, "TANGENT"), [mesh_of(islands)]
    values[:2, :2] = (0.6, 0, 0.8, 1)
    texels, state = finished(values, lows, margin=16, margin_type="ADJACENT_FACES")
    plain, _ = finished(values, lows, margin=16)
    left = islands[0].point(place)
    beyond = (state == MARGIN) & (left.real < -1.02)
    assert np.count_nonzero(beyond) > 500
    assert np.array_equal(texels[beyond], plain[beyond])
    assert not np.array_equal(texels, plain)


def numbered(islands):
    """The number of each texel's island from 1, and 0 outside: (H, W) float32."""
    numbers = np.zeros(SIZE[::-1], np.float32)
    for number, island in enumerate(islands, start=1):
        numbers[island.is_over(places())] = number
    return numbers


def test_margin_across_a_narrow_island_has_nothing_of_the_next_island_on_the_map():
    narrow = Island((0, -1), (0.15, 1), center=(120, 80), scale=45.0, degrees=0.0)
    stranger = Island((5, -1), (6, 1), center=(150, 80), scale=45.0, degrees=0.0)
    islands = [cut(degrees=0.0)[0], narrow, stranger]
    numbers = numbered(islands)
    values = np.stack([numbers, numbers, numbers, numbers > 0.0], axis=-1).astype(np.float32)
    texels, state = finished(values, [mesh_of(islands)], name="OBJECT_ID", margin=12, margin_type="ADJACENT_FACES")
    z = islands[0].point(places())
    beside = (state == MARGIN) & (z.real > 0.0) & (z.real * 45.0 < 12.5) & (np.abs(z.imag) < 0.9)
    far = z.real[beside] * 45.0
    assert np.array_equal(texels[beside][:, 0], np.where(far < 0.15 * 45.0, 2.0, 1.0))
    assert (far > 8.0).any()
    assert set(np.unique(texels[..., 0])) == {0.0, 1.0, 2.0, 3.0}


@pytest.mark.parametrize("backwards", [False, True])
def test_texels_between_two_seams_continue_across_the_nearer_one(backwards):
    def strip(low, high, left):
        return Island((low, -1), (high, 1), center=(left + (high - low) * 22.5, 80), scale=45.0, degrees=0.0)

    # 1 continues in 2, and 3 in 4. Between 1 and 3 are two texels, which the strips along both borders cover.
    islands = [strip(-1, 0, 10.2), strip(0, 0.5, 120.2), strip(5, 6, 57.2), strip(4.5, 5, 160.2)]
    numbers = numbered(islands)
    values = np.stack([numbers, numbers, numbers, numbers > 0.0], axis=-1).astype(np.float32)
    low = mesh_of(islands[::-1] if backwards else islands)
    texels, _ = finished(values, [low], name="OBJECT_ID", margin=16, margin_type="ADJACENT_FACES")
    assert np.array_equal(texels[80, 50:62, 0], [1] * 5 + [2, 4] + [3] * 5)


@pytest.mark.parametrize("margin", [20, None])
def test_nearest_texel_stays_far_from_a_seam(monkeypatch, margin):
    monkeypatch.setattr(margins, "REACH", 8)
    islands = cut(degrees=37.0)
    values, lows = drawn(islands, "TANGENT"), [mesh_of(islands)]
    texels, state = finished(values, lows, margin=margin, margin_type="ADJACENT_FACES")
    plain, plain_state = finished(values, lows, margin=margin)
    assert np.array_equal(state, plain_state)
    z = islands[0].point(places())
    beside = (np.abs(z.imag) < 0.8) & (z.real > 0.0)
    far = z.real * 45.0
    assert np.array_equal(texels[beside & (far > 9.0) & (far < 15.0)], plain[beside & (far > 9.0) & (far < 15.0)])
    assert np.isclose(texels, plain, atol=1e-4).all(axis=-1)[beside & (far < 8.0)].mean() < 0.1


def test_labels_are_never_mixed_but_values_are(in_bands):
    """Numbers that change along the seam, as labels and as values."""
    islands = cut(degrees=37.0)
    values = np.zeros((*SIZE[::-1], 4), np.float32)
    for island in islands:
        over = island.is_over(places())
        values[over, :3] = np.round(10.0 * island.point(places()).imag[over])[:, None]
        values[over, 3] = 1.0

    def maps_of():
        options = {"margin": 16, "margin_type": "ADJACENT_FACES"}
        both = (finished(values, [mesh_of(islands)], name=name, **options)[0] for name in ("OBJECT_ID", "POSITION"))
        return [texels[..., 0] for texels in both]

    labels, position = maps_of()
    assert np.array_equal(labels, np.round(labels))
    assert np.count_nonzero(position != np.round(position)) > 50
    assert np.abs(labels - position).max() <= 1.0
    in_bands(30, 64)
    for whole, banded in zip((labels, position), maps_of(), strict=True):
        assert np.count_nonzero(np.abs(whole - banded) > 1e-4) < 5


@pytest.mark.parametrize("name", ["NORMAL", "POSITION"])
@pytest.mark.parametrize("is_banded", [False, True])
def test_nearest_texel_stays_where_normals_cancel_out_across_a_seam(in_bands, name, is_banded):
    """Opposite normals in every second column, and a seam between two columns."""
    size = 256, 128  # powers of two, so that positions of texels are exact
    islands = [
        Island((-1, -1), (0, 1), center=(48.5, 64), scale=32.0, degrees=0.0),
        Island((0, -1), (1, 1), center=(150, 64), scale=32.0, degrees=0.0),
    ]
    values = np.zeros((*size[::-1], 4), np.float32)
    for island in islands:
        values[island.is_over(places(size)), 3] = 1.0
    values[..., 2] = np.where(np.arange(size[0]) % 2, 1.0, -1.0) * values[..., 3]
    right = islands[1].is_over(places(size))
    left = islands[0].point(places(size))
    beside = (left.real > 0.0) & (left.real * 32.0 < 4.0) & (np.abs(left.imag) < 0.8)
    if is_banded:
        in_bands(30, 64)
    texels, state = finished(
        values, [mesh_of(islands, size)], name=name, space="OBJECT", margin=4, margin_type="ADJACENT_FACES"
    )
    assert np.isfinite(texels).all()
    assert (state[beside] == MARGIN).all()
    assert np.array_equal(np.unique(texels[right][:, 2]), [0.0, 1.0] if name == "NORMAL" else [-1.0, 1.0])
    nearest = texels[64, 64, 2]  # the last column of the left island
    assert (texels[beside][:, 2] == (nearest if name == "NORMAL" else 0.0)).all()


def test_channels_are_swapped_after_the_rotation():
    islands = cut(degrees=37.0)
    values, lows = drawn(islands, "TANGENT"), [mesh_of(islands)]
    options = {"margin": 16, "margin_type": "ADJACENT_FACES"}
    plain, state = finished(values, lows, **options)
    swapped, _ = finished(values, lows, red="-Y", green="+Z", blue="+X", **options)
    plain, swapped = plain[state > 0], swapped[state > 0]
    assert np.allclose(swapped[:, :3], np.stack([1.0 - plain[:, 1], plain[:, 2], plain[:, 0]], axis=1), atol=1e-6)


def test_margin_is_the_same_on_another_tile():
    islands = cut(degrees=37.0)
    values, low = drawn(islands, "TANGENT"), mesh_of(islands)
    options = {"margin": 16, "margin_type": "ADJACENT_FACES"}
    here, _ = finished(values, [low], **options)
    there, _ = finished(values, [replace(low, uv=low.uv + np.float32((2, 1)))], tile=1013, **options)
    # UVs have less precision there.
    assert np.count_nonzero(np.abs(here - there).max(axis=-1) > 1e-3) < 20


def test_a_hole_across_a_seam_is_not_continued():
    islands = cut(degrees=0.0)
    values, low = drawn(islands, "TANGENT"), mesh_of(islands)
    hole = (np.abs(islands[1].point(places()).imag) < 0.2) & (values[..., 3] > 0.0) & (places().real > 100)
    values[hole] = (0, 0, 0, -1)
    texels, state = finished(values, [low], margin=16, margin_type="ADJACENT_FACES")
    plain, plain_state = finished(values, [low], margin=16)
    assert np.array_equal(state, plain_state)
    assert (state[hole] == MISSED).all()
    left = islands[0].point(places())
    beside = (state == MARGIN) & (np.abs(left.imag) < 0.15) & (left.real > 0.0) & (left.real < 0.2)
    assert np.array_equal(texels[beside], plain[beside])


@pytest.mark.parametrize("name", ["37 degrees", "mirrored at 127 degrees"])
@pytest.mark.parametrize("space", ["TANGENT", "WORLD"])
def test_a_baked_seam_continues_as_if_uncut(space, name):
    """In a whole bake. The expected map is a bake of only the left half, extended past the seam."""
    islands = cut(**CUTS[name])
    left = islands[0]
    grown = Island((-1, -1), (0.3, 1), center=(48 + 0.15 * 45.0, 80), scale=45.0, degrees=0.0)
    high = zoo.terrain("high", n=96, height=0.1, waves=1)
    options = {"method": "CAST", "extrusion": 0.5, "max_distance": 1.0, "size": SIZE, "space": space}

    def low(name, islands):
        corners = [(i.low, complex(i.high.real, i.low.imag), i.high, complex(i.low.real, i.high.imag)) for i in islands]
        points = [(z.real, z.imag, 0.0) for z in np.unique(corners)]
        faces = np.searchsorted(np.unique(corners), corners)
        uv = np.array([i.place(z) for i, z in zip(islands, np.array(corners), strict=True)])
        return zoo.build(name, points, faces, np.stack([uv.real, uv.imag], axis=-1) / SIZE)

    texels = maps.bake(low("cut", islands), high, margin=12, margin_type="ADJACENT_FACES", image="cut", **options)
    truth = maps.bake(low("grown", [grown]), high, margin=0, image="grown", **options)
    z = left.point(places())
    beside = (truth[..., 3] > 0.0) & (z.real > 0.0) & (z.real < 0.2) & (np.abs(z.imag) < 0.8)
    assert np.count_nonzero(beside) > 500
    error = angles.degrees(angles.decode(texels), angles.decode(truth))[beside]
    assert np.percentile(error, 99) < 0.5
    assert error.max() < 1.5  # beside the seam itself, half a texel off
