# SPDX-License-Identifier: GPL-3.0-or-later
"""Which triangles of high meshes are clear, in part or all: those alone cost rays a second look."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.material_feeds import Extension
from ..mesh import cutouts as of_mesh
from ..mesh.triangle_mesh import Alpha, Mesh
from ..passes import cutouts

RAMP = Alpha(np.array([[-1.0, 1.0]], np.float32), Extension.EXTEND, 0.0, True, ())
"""An image from -1 at the center of its first pixel to 1 at that of the second: it shows what corners have as their value."""


def records_of(highs: Sequence[Mesh], order: np.ndarray) -> cutouts.Records | None:
    """Where the triangles of `highs` are clear; None if none of them is. order (T,) int: theirs in the tree."""
    if not any(map(of_mesh.has_layer, highs)):
        return None
    images = [RAMP, *{id(alpha): alpha for high in highs for alpha in high.alphas}.values()]
    of_highs = [_of(high, np.array([0, *map(images.index, high.alphas)])) for high in highs]
    may_be, places, numbers = (np.concatenate(each)[order] for each in zip(*of_highs, strict=True))
    if not may_be.any():
        return None
    places, numbers, pixels = places[may_be], numbers[may_be], list(map(_pixels, images))
    scales = np.array(_fit(pixels), np.float32)[numbers]
    return cutouts.Records(np.where(may_be, np.cumsum(may_be), 0), places * scales[:, None, None], numbers, pixels)


def _pixels(alpha: Alpha) -> cutouts.AlphaPixels:
    values = alpha.values
    if alpha.extension == Extension.MIRROR:
        values = np.concatenate([values, values[:, ::-1]], axis=1)
        values = np.concatenate([values, values[::-1]])
    outside = alpha.outside if alpha.extension == Extension.CLIP else None
    repeats = alpha.extension in {Extension.REPEAT, Extension.MIRROR}
    return cutouts.AlphaPixels(values, outside, repeats, alpha.is_smooth)


def _fit(images: list[cutouts.AlphaPixels]) -> list[float]:
    """Give the largest images half the pixels along each side, or less, so that all fit. Returns the shares that are left."""
    shares = [1.0] * len(images)
    while sum(each.values.size for each in images) > cutouts.MOST_PIXELS:
        largest = max(range(len(images)), key=lambda number: images[number].values.size)
        values = images[largest].values
        height, width = (side // 2 for side in np.shape(values))
        values = values[: 2 * height, : 2 * width].reshape(height, 2, width, 2).mean(axis=(1, 3))
        images[largest], shares[largest] = replace(images[largest], values=values), shares[largest] * 0.5
    return shares


def _of(high: Mesh, images: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which triangles of a mesh may be clear (T,) bool, the places of their corners (T, 3, 2) in pixels of an image, and its
    number (T,) int. images: the numbers of RAMP, and of the mesh's own ones."""
    layer, triangles = high.layers.get(of_mesh.KEY), high.front_triangles
    if layer is None:
        return (
            np.zeros(len(triangles), bool),
            np.zeros((len(triangles), 3, 2), np.float32),
            np.zeros(len(triangles), int),
        )
    kinds, places = layer[triangles[:, 0], 2].astype(int), layer[triangles][..., :2]
    may_be = kinds == of_mesh.CLEAR
    places[may_be, :, 0] = -1.0
    is_value = (kinds == of_mesh.DIRECT) | may_be
    may_be |= is_value & (places[..., 0].min(axis=1) < 0.0)
    places[is_value, :, 0] = 0.5 * places[is_value, :, 0] + 1.0
    for number, alpha in enumerate(high.alphas, start=1):
        some = kinds == number
        may_be[some] = ~_are_opaque(alpha, places[some])
    return may_be, places, images[np.maximum(kinds, 0)]


def _are_opaque(alpha: Alpha, places: np.ndarray) -> np.ndarray:
    """Which triangles (N,) bool show no pixel that is clear, by their boxes. places: (N, 3, 2), in pixels."""
    width, height = size = np.array(alpha.size)
    low = np.floor(places.min(axis=1) - 0.5).astype(np.int64)
    high = np.floor(places.max(axis=1) - 0.5).astype(np.int64) + 1
    if alpha.extension == Extension.REPEAT:
        tile = low // size * size
        low, high = low - tile, high - tile
    elif alpha.extension == Extension.EXTEND:
        low, high = low.clip(0, size - 1), high.clip(0, size - 1)
    is_within = ((low >= 0) & (high < size)).all(axis=1)
    sums = np.zeros((height + 1, width + 1), np.int32)
    np.cumsum(np.cumsum(alpha.values < 0.0, axis=0, dtype=np.int32), axis=1, out=sums[1:, 1:])
    left, bottom = np.minimum(low, size - 1).clip(0).T
    right, top = 1 + np.minimum(high, size - 1).clip(0).T
    clear = sums[top, right] - sums[bottom, right] - sums[top, left] + sums[bottom, left]
    return is_within & (clear == 0)
