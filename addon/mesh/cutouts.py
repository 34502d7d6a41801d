# SPDX-License-Identifier: GPL-3.0-or-later
"""Where high meshes are clear, by the alpha of their materials: a layer of the mesh, and images that it is for."""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ..core import udim
from ..core.errors import shorten_list
from ..core.material_feeds import (
    AVERAGE,
    LUMINANCE,
    LUMINANCE_WEIGHTS,
    AttributeFeed,
    Constant,
    CutOut,
    ExactFeed,
    Extension,
    ImageFeed,
    ImagePixels,
)
from .inputs import HitsOfFeed, LoadImage, Meshes
from .triangle_mesh import ATTRIBUTE, CUTOUT, UV_LAYER, Alpha, Mesh

KEY = CUTOUT, ""
"""Of the layer (C, 3): places in the pixels of an image of Mesh.alphas, and its number from 1; or one of these two numbers."""
OPAQUE, DIRECT, CLEAR = 0, -1, -2
"""Nothing is clear; where the first value is below 0; everything."""


def cut_out(meshes: Meshes, before: Sequence[Mesh] = ()) -> Meshes:
    """`meshes` whose high meshes know where they are clear. before: those of an earlier reading.

    A mesh of that reading, and an image, stay the very same while they show the same: Live finds changes by that. Where nothing
    at all would be opaque, nothing is clear.
    """
    if not any(material.cutout for material in meshes.materials):
        return meshes
    images = {alpha.of: alpha for high in before for alpha in high.alphas}
    known = {of: alpha for of, alpha in images.items() if _is_as_read(alpha, meshes.load_image)}
    highs = [with_cutouts(high, meshes, known) for high in meshes.highs]
    clear = [repr(high.name) for high in highs if is_clear(high)]
    if clear:
        of = shorten_list(clear)
        text = f"The alpha of {of} is below its threshold everywhere: rays see it only where they meet nothing else."
        meshes = replace(meshes, lacks=list(dict.fromkeys([*meshes.lacks, text])))
    return replace(meshes, highs=list(map(_solid, highs)) if len(clear) == len(highs) else highs)


def has_layer(high: Mesh) -> bool:
    """Whether a mesh may be clear somewhere."""
    return KEY in high.layers


def is_clear(high: Mesh) -> bool:
    """Whether all of a mesh is clear."""
    if not has_layer(high):
        return False
    values, _, kinds = high.layers[KEY][high.triangles].reshape(-1, 3).T
    return bool(((kinds == CLEAR) | ((kinds == DIRECT) & (values < 0.0))).all())


def checksums(high: Mesh) -> tuple:
    """What tells where a mesh is clear from another one; empty if nothing of it is. It is found once."""
    if not has_layer(high):
        return ()
    arrays = high.layers[KEY], *(alpha.values for alpha in high.alphas)
    return high.remembered("checksum cut-outs", (), lambda: tuple(map(zlib.crc32, map(np.ascontiguousarray, arrays))))


def names(meshes: Meshes) -> list[str]:
    """The materials of which something is clear, on the high meshes."""
    found: dict[str, None] = {}
    for high in filter(has_layer, meshes.highs):
        is_clear_somewhere = high.layers[KEY][high.triangles[:, 0], 2] != OPAQUE
        numbers = np.unique(high.labels[is_clear_somewhere, 1]).astype(int)
        found |= dict.fromkeys(meshes.materials[number - 1].name for number in numbers.tolist())
    return list(found)


Shown: TypeAlias = tuple[Alpha, np.ndarray, np.ndarray]
"""An image, the triangles (N, 3) that show it, and the places of their corners (N, 3, 2) in its pixels."""
Known: TypeAlias = dict[tuple, Alpha]
"""Images by what they were made of, to which those that are made are added."""


def with_cutouts(high: Mesh, meshes: Meshes, known: Known) -> Mesh:
    """A mesh with the layer and the images of its materials' cut-outs; as it is if none of it is clear."""
    if high.labels is None:
        return high
    of_material = high.labels[:, 1].astype(np.int64)
    layer = np.zeros((len(high.vertices), 3), np.float32)
    alphas: list[Alpha] = []
    for number in np.unique(of_material[of_material > 0]).tolist():
        cut, triangles = meshes.materials[number - 1].cutout, high.triangles[of_material == number]
        match cut and cut.feed:
            case Constant():
                layer[triangles, 2] = CLEAR
            case AttributeFeed(name=name):
                values = high.layers.get((ATTRIBUTE, name), np.zeros((len(layer), 4), np.float32))[triangles]
                layer[triangles, 0] = value_of(cut.feed, values) - cut.threshold
                layer[triangles, 2] = DIRECT
            case ImageFeed() as feed:
                _add(layer, alphas, _by_tile(high, triangles, cut, meshes, known, feed=feed))
            case ExactFeed() as feed:
                _add(layer, alphas, _evaluated(high, triangles, cut, meshes, known, feed=feed))
    if not layer[:, 2].any():
        return _solid(high)
    if has_layer(high) and high.alphas == tuple(alphas) and np.array_equal(high.layers[KEY], layer):
        return high
    return replace(high, layers=high.layers | {KEY: layer}, alphas=tuple(alphas))


def _solid(high: Mesh) -> Mesh:
    """A mesh of which nothing is clear."""
    if not has_layer(high):
        return high
    return replace(high, layers={key: layer for key, layer in high.layers.items() if key != KEY}, alphas=())


def _add(layer: np.ndarray, alphas: list[Alpha], shown: Iterable[Shown]) -> None:
    """Write what images show into a layer, and put them into `alphas`."""
    for alpha, triangles, places in shown:
        if alpha.is_all(clear=True):
            layer[triangles, 2] = CLEAR
        elif not alpha.is_all(clear=False):
            alphas.append(alpha)
            layer[triangles, :2] = places
            layer[triangles, 2] = len(alphas)


def _by_tile(
    high: Mesh, triangles: np.ndarray, cut: CutOut, meshes: Meshes, known: Known, *, feed: ImageFeed
) -> Iterator[Shown]:
    """What the triangles of a material show of an image, and of each of its tiles: the middle of a triangle says which."""
    rows = np.array(feed.mapping)
    shown = _uv(high, feed.uv_layer)[triangles] @ rows[:, :2].T + rows[:, 2]
    middles = np.floor(shown.mean(axis=1))
    for tile in feed.tiles or (0,):
        corner = np.array(udim.place(tile) if tile else (0, 0))
        some = (middles == corner).all(axis=1) if tile else np.ones(len(triangles), bool)
        if some.any():
            alpha = _loaded(cut, feed, tile, meshes.load_image, known)
            yield alpha, triangles[some], (shown[some] - corner) * alpha.size


def _loaded(cut: CutOut, feed: ImageFeed, tile: int, load_image: LoadImage, known: Known) -> Alpha:
    key = cut, tile
    if key not in known:
        extension = Extension.EXTEND if tile else feed.extension
        outside = float(value_of(feed, np.zeros((1, 4), np.float32))[0] - cut.threshold)
        known[key] = Alpha(_read(cut, feed, tile, load_image), extension, outside, feed.is_smooth, key)
    return known[key]


def _is_as_read(alpha: Alpha, load_image: LoadImage) -> bool:
    """Whether an image of an earlier reading still has its pixels."""
    cut, *of = alpha.of
    feed = cut.feed
    return isinstance(feed, ImageFeed) and np.array_equal(alpha.values, _read(cut, feed, of[0], load_image))


def _read(cut: CutOut, feed: ImageFeed, tile: int, load_image: LoadImage) -> np.ndarray:
    """The values (h, w) float32 of an image, of which those below 0 are clear."""
    values = alpha_values(feed, load_image(feed.image, tile)) - cut.threshold
    return values.astype(np.float32)


EVALUATED = 512
"""Pixels along the longer side of the UVs that a material covers, where Cycles evaluates its alpha: 2.6 seconds on one core."""


def _evaluated(
    high: Mesh, triangles: np.ndarray, cut: CutOut, meshes: Meshes, known: Known, *, feed: ExactFeed
) -> Iterator[Shown]:
    """What they show of an alpha that nodes make of UVs: Cycles evaluates it on a square that has them."""
    ((_, name),) = feed.layers
    uv = _uv(high, name)[triangles]
    low, high_end = uv.reshape(-1, 2).min(axis=0), uv.reshape(-1, 2).max(axis=0)
    extent = np.maximum(high_end - low, 1e-6)
    size = np.ceil(EVALUATED * extent / extent.max()).astype(int)
    key = cut, *low.tolist(), *extent.tolist()
    if key not in known:
        corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
        square = Mesh.of_arrays(high.name, np.pad(corners, ((0, 0), (0, 1))), np.array([(0, 1, 2), (0, 2, 3)]))
        square = replace(square, layers={feed.layers[0]: (low + corners[square.vertices] * extent).astype(np.float32)})
        v, u = ((np.indices(size[::-1]) + 0.5) / size[::-1, None, None]).reshape(2, -1)
        is_upper = v > u
        weights = np.where(is_upper, (1.0 - v, u, v - u), (1.0 - u, u - v, v)).T.astype(np.float32)
        hits = HitsOfFeed(feed, square, 1, is_upper.astype(int), weights)
        values = meshes.evaluate([hits])[0][:, 0].reshape(size[::-1]) - cut.threshold
        known[key] = Alpha(values.astype(np.float32), Extension.EXTEND, 0.0, True, key)
    yield known[key], triangles, (uv - low) / extent * size


def _uv(high: Mesh, name: str) -> np.ndarray:
    """A UV map (C, 2) float64; zeros if the mesh lacks it."""
    return high.layers.get((UV_LAYER, name), np.zeros((len(high.vertices), 2))).astype(np.float64)


def alpha_values(feed: ImageFeed, pixels: ImagePixels) -> np.ndarray:
    """The values (h, w) of a feed at the pixels of its image."""
    values = pixels.values
    if pixels.is_srgb and feed.channel != 3:
        values = values.copy()
        low, color = values[..., :3] <= 0.04045, values[..., :3]
        values[..., :3] = np.where(low, color / 12.92, ((np.maximum(color, 0.0) + 0.055) / 1.055) ** 2.4)
    return value_of(feed, values)


def value_of(feed: ImageFeed | AttributeFeed, values: np.ndarray) -> np.ndarray:
    """The number that a feed makes of colors (..., 4)."""
    limits = feed.limits
    if feed.channel == LUMINANCE:
        value = np.clip(values[..., :3], limits.least, limits.most) @ np.array(LUMINANCE_WEIGHTS)
    elif feed.channel == AVERAGE:
        value = np.clip(values[..., :3], limits.least, limits.most).mean(axis=-1)
    else:
        value = values[..., feed.channel or 0]
    return np.clip(value, limits.low[0], limits.high[0]) * feed.scale[0] + feed.offset[0]
