# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodes the values of maps other than the normal map, and returns how to decode them."""

import colorsys
from collections.abc import Sequence

import numpy as np

from ..core.map_types import Kind, MapType, Range
from ..core.settings import Settings

GOLDEN = 0.6180339887498949
"""A step around the circle of hues that keeps any number of hues distinct."""


def encoding(map_type: MapType, maps: Sequence[np.ndarray], labels: Sequence[str], settings: Settings) -> dict:
    """How to decode a map: value = (stored - midlevel) * scale + offset, or the colors of its labels.

    maps: its tiles, (height, width, 4) float32 with alpha 0 where there is no value. labels: the names of the numbers from 1.
    """
    if map_type.kind is Kind.LABEL:
        return {"colours": {label: list(color(number)) for number, label in enumerate(labels)}}
    if map_type.range is Range.UNIT or settings.is_float:
        return {"midlevel": 0.0, "scale": 1.0}
    lows, highs = zip(*(_range(texels) for texels in maps), strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    if map_type.range is Range.BOX:
        return {"midlevel": 0.0, "scale": float((high - low).max()) or 1.0, "offset": low.tolist()}
    if map_type.range is Range.POSITIVE:
        return {"midlevel": 0.0, "scale": float(high.max()) or 1.0}
    return {"midlevel": 0.5, "scale": 2.0 * float(max(-low.min(), high.max(), 0.0)) or 1.0}


def encode(texels: np.ndarray, how: dict) -> None:
    """Encode `texels` (height, width, 4) float32 in place. Alpha does not change. how: the result of `encoding`."""
    known = texels[..., 3:] > 0.0
    if "colours" in how:
        np.copyto(texels[..., :3], np.float32(0.0), where=~known)
        # There can be more numbers than names: a linked object may have the name of a local one.
        count = int(texels[..., 0].max())
        palette = np.array([(0.0, 0.0, 0.0), *map(color, range(count))], np.float32)
        texels[..., :3] = palette[texels[..., 0].astype(np.int32)]
    else:
        if (how["midlevel"], how["scale"]) != (0.0, 1.0):
            texels[..., :3] -= np.float32(how.get("offset", 0.0))
            texels[..., :3] /= np.float32(how["scale"])
            texels[..., :3] += np.float32(how["midlevel"])
        np.copyto(texels[..., :3], np.float32(how["midlevel"]), where=~known)


def color(number: int) -> tuple[float, float, float]:
    """A color for each number from 0, none of them black."""
    return colorsys.hsv_to_rgb(number * GOLDEN % 1.0, 0.65 + 0.35 * (number // 7 % 2), 1.0 - 0.3 * (number // 14 % 2))


def _range(texels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest value of each channel, (3,) each, where alpha is above 0."""
    known = texels[texels[..., 3] > 0.0][:, :3]
    return (known.min(axis=0), known.max(axis=0)) if len(known) else (np.zeros(3), np.zeros(3))
