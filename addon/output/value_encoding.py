# SPDX-License-Identifier: GPL-3.0-or-later
"""How values become numbers of 8 or 16 bits: ranges and curves of maps, rounding, dithering, and the error of normals."""

import colorsys
from collections.abc import Mapping, Sequence

import numpy as np

from ..core.map_types import FILLED, Kind, Map, MapType, Packing, Range
from ..core.settings import StorageSettings

HALF, MOST_HALF = 16, np.float32(65504.0)
"""The bits of floats that cannot hold all values, and the highest of them, which higher values become."""
SAMPLES = 1 << 17
"""The error is measured on about this many texels of a tile at most."""
# Multiples of 1/g, 1/g^2 and 1/g^3, with g^4 = g + 1, spread evenly over rows, columns and channels together
# (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018); here in units of 2^-32, which wrap around.
_G = 1.2207440846057596
_ROW, _COLUMN, _CHANNEL = (int(2**32 / _G**power) for power in (1, 2, 3))


def steps(values: np.ndarray, depth: int) -> np.ndarray:
    """`values` float32 as whole numbers of `depth` bits, uint8 or uint16: the nearest, from 0 for 0 to the highest for 1.

    NaN becomes 0.
    """
    most = np.float32(2**depth - 1)
    scaled = values * most
    scaled += np.float32(0.5)
    np.clip(scaled, np.float32(0.0), most, out=scaled)
    with np.errstate(invalid="ignore"):  # NaN
        return scaled.astype(np.uint8 if depth == 8 else np.uint16)


def rounded(values: np.ndarray, depth: int) -> np.ndarray:
    """`values` float32 from 0 to 1, rounded to multiples of 1 / (2^depth - 1) as Blender does."""
    steps = np.float32(2**depth - 1)
    return np.floor(values * steps + np.float32(0.5)) / steps


def in_steps(texels: np.ndarray, step: int, *, is_normal: bool = False, with_alpha: bool = False) -> np.ndarray:
    """`texels` (height, width, 4) float32 from 0 to 1, rounded to multiples of step / 255 and to 1, off by half a step at most.

    is_normal: count from 128 / 255, so that flat normals stay as 8 bits have them. with_alpha: round alpha as well.
    """
    result, channels = texels.copy(), 4 if with_alpha else 3
    middle = np.float32(128.0 if is_normal else 0.0)
    values = texels[..., :channels] * np.float32(255.0)
    rounded = np.rint((values - middle) / np.float32(step)) * np.float32(step) + middle
    if not is_normal:
        rounded[values > (255 // step * step + 255) / 2] = 255.0
    result[..., :channels] = np.clip(rounded / np.float32(255.0), 0.0, 1.0)
    return result


def dithered(texels: np.ndarray, *, with_alpha: bool = False) -> np.ndarray:
    """`texels` (height, width, 4) float32 as multiples of 1/255. Their mean over a neighborhood stays the same.

    Each color is rounded up or down by a threshold that depends only on its position, so that each bake gives the same
    result. Alpha, and colors where alpha is 0, are rounded to the nearest multiple: the background keeps one color.
    with_alpha: dither alpha as well, and all colors, because alpha holds a map.
    """
    height, width = texels.shape[:2]
    rows, columns = (np.arange(side, dtype=np.uint32) for side in (height, width))
    lattice = rows[:, None] * np.uint32(_ROW) + columns * np.uint32(_COLUMN)
    is_background = (texels[..., 3] == 0.0) & (not with_alpha)
    result = texels * np.float32(255.0)
    for channel in range(4 if with_alpha else 3):
        # 15 bits, neither 0 nor 1: added to 255, they are exact in single precision.
        threshold = ((lattice + np.uint32(channel * _CHANNEL % 2**32)) >> 17).astype(np.float32)
        threshold += np.float32(0.5)
        threshold *= np.float32(2**-15)
        threshold[is_background] = 0.5
        result[..., channel] += threshold
    if not with_alpha:
        result[..., 3] += np.float32(0.5)
    np.floor(result, out=result)
    result /= np.float32(255.0)
    return result


def sample_texels(texels: np.ndarray) -> np.ndarray:
    """Texels (N, 4) from all parts of (height, width, 4)."""
    flat = texels.reshape(-1, 4)
    return flat[:: (len(flat) // SAMPLES) | 1]  # an odd step does not take the same few columns of each row


def sample_blocks(texels: np.ndarray, most: int = SAMPLES) -> np.ndarray:
    """Some rows of blocks of 4 x 4 texels, (4 B, width, ...), from all parts of (height, width, ...): about `most` texels, or
    all if there are no more."""
    height, width = texels.shape[:2]
    if height * width <= most:
        return texels
    rows = texels[height % 4 :].reshape(-1, 4, *texels.shape[1:])  # blocks begin at the top
    return rows[:: (height * width // most) | 1].reshape(-1, *texels.shape[1:])


def angles_between(texels: np.ndarray, stored: np.ndarray) -> np.ndarray:
    """Degrees (M,) float32 between the normals of texels (N, 4) and the stored ones, where alpha is not 0."""
    is_written = texels[:, 3] > 0.0
    before, after = (_unit_normals(values[is_written, :3].T) for values in (texels, stored))
    # From the chord: the cosine of a small angle is too close to 1 for a precise result.
    after -= before
    chord = _lengths(after)
    return np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))).astype(np.float32)


def _unit_normals(columns: np.ndarray) -> np.ndarray:
    """The normals (3, N) float64 of stored values: columns, because numpy is slow along short rows."""
    vectors = columns.astype(np.float64, order="C") * 2.0 - 1.0
    vectors /= np.maximum(_lengths(vectors), 1e-30)
    return vectors


def _lengths(columns: np.ndarray) -> np.ndarray:
    return np.sqrt(np.square(columns).sum(axis=0))


GOLDEN = 0.6180339887498949
"""A step around the circle of hues that keeps any number of hues distinct."""
ENCODED_ROWS = 16
"""The number of rows that are encoded as sRGB at a time."""
TOE = 0.0031308
"""The linear value up to which the curve of sRGB is a line."""
SRGB, LINEAR = "sRGB", "Linear Rec.709"
"""Blender's names of the color spaces of colors in integers and in floats."""


def encoding(map_type: MapType, maps: Sequence[np.ndarray], labels: Sequence[str], storing: StorageSettings) -> dict:
    """How to decode a map: value = (stored - midlevel) * scale + offset, or the colors of its labels.

    With a color_space, `stored` is linear after decoding the space. maps: its tiles, (height, width, 4) float32 with alpha 0
    where there is no value. labels: the names of the numbers from 1.
    """
    if map_type.kind is Kind.LABEL:
        return {"colours": {label: list(color(number)) for number, label in enumerate(labels)}}
    if map_type.kind is Kind.NORMAL:  # encoded when it was drawn
        return {"midlevel": 0.5, "scale": 2.0}
    space = {"color_space": color_space(map_type, storing)} if map_type.is_color else {}
    if not needs_range(map_type, storing):
        return {"midlevel": 0.0, "scale": 1.0} | space
    if storing.value_range is not None and not map_type.is_color:
        return _fixed(map_type, storing.value_range)
    lows, highs = zip(*(_range(texels) for texels in maps), strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    if map_type.range is Range.BOX:
        return {"midlevel": 0.0, "scale": float((high - low).max()) or 1.0, "offset": low.tolist()}
    if map_type.is_color:  # only lights that are too bright for the format are scaled
        return {"midlevel": 0.0, "scale": max(1.0, float(high.max()))} | space
    if map_type.range is Range.POSITIVE:
        return {"midlevel": 0.0, "scale": float(high.max()) or 1.0}
    return {"midlevel": 0.5, "scale": 2.0 * float(max(-low.min(), high.max(), 0.0)) or 1.0}


def _fixed(map_type: MapType, reach: float) -> dict:
    """As `encoding`, for values up to `reach`, and from -reach if they can be below 0."""
    if map_type.range is Range.POSITIVE:
        return {"midlevel": 0.0, "scale": reach}
    if map_type.range is Range.BOX:
        return {"midlevel": 0.0, "scale": 2.0 * reach, "offset": [-reach] * 3}
    return {"midlevel": 0.5, "scale": 2.0 * reach}


def needs_range(map_type: MapType, storing: StorageSettings) -> bool:
    """Whether the encoding depends on the range of the values in all tiles."""
    return map_type.kind is Kind.VALUE and map_type.range is not Range.UNIT and not storing.is_float


def color_space(map_type: MapType, storing: StorageSettings) -> str:
    """The color space of the image of a map; empty for data."""
    if not map_type.is_color:
        return ""
    return LINEAR if storing.is_float else SRGB


def known(drawn: Map) -> np.ndarray:
    """Which texels (height, width) bool have a value: those that were written, the margin, and misses that were filled."""
    texels, state = drawn
    return (texels[..., 3] > 0.0) | (state == FILLED)


def encode(drawn: Map, how: dict) -> None:
    """Encode the texels of a map in place. Alpha does not change. how: the result of `encoding`."""
    texels, is_known = drawn[0], known(drawn)[..., None]
    if "colours" in how:
        np.copyto(texels[..., :3], np.float32(0.0), where=~is_known)
        texels[..., :3] = palette(int(texels[..., 0].max()))[texels[..., 0].astype(np.int32)]
    else:
        offset = how.get("offset", 0.0)
        if (how["midlevel"], how["scale"], offset) != (0.0, 1.0, 0.0):
            texels[..., :3] -= np.float32(offset)
            texels[..., :3] /= np.float32(how["scale"])
            texels[..., :3] += np.float32(how["midlevel"])
        if how.get("color_space") == SRGB:
            for start in range(0, len(texels), ENCODED_ROWS):  # a few rows at a time, which stay in the cache
                rows = texels[start : start + ENCODED_ROWS, :, :3]
                rows[...] = to_srgb(rows)
        np.copyto(texels[..., :3], np.float32(how["midlevel"]), where=~is_known)


def packed(packing: Packing, maps: Mapping[str, Map]) -> np.ndarray:
    """A packed image (height, width, 4) float32 of encoded maps by name. Alpha is a channel as others.

    Backgrounds stay as they are, also in an inverted channel.
    """
    result = np.empty(next(iter(maps.values()))[0].shape, np.float32)
    for number, channel in enumerate(packing.channels):
        if channel.map:
            drawn = maps[channel.map]
            values = drawn[0][..., 0]
            result[..., number] = np.where(known(drawn), 1.0 - values, values) if channel.is_inverted else values
        else:
            result[..., number] = channel.constant
    return result


def channels(packing: Packing, encodings: Mapping[str, dict]) -> dict[str, dict]:
    """How to decode each channel of a packed image: the map, whether it is inverted, and its encoding; or the constant."""
    channels = {}
    for name, channel in packing.by_name().items():
        if not channel.map:
            channels[name] = {"constant": channel.constant}
            continue
        inverted = {"inverted": True} if channel.is_inverted else {}
        channels[name] = {"map": channel.map.lower()} | inverted | encodings[channel.map]
    return channels


def to_srgb(values: np.ndarray) -> np.ndarray:
    """Linear values as sRGB stores them, from 0 to 1 (IEC 61966-2-1)."""
    clipped = np.clip(values, np.float32(0.0), np.float32(1.0))
    curved = np.maximum(clipped, np.float32(TOE))
    # The logarithm and the exponential of numpy are several times as fast as its power.
    np.log(curved, out=curved)
    curved *= np.float32(1.0 / 2.4)
    np.exp(curved, out=curved)
    curved *= np.float32(1.055)
    curved -= np.float32(0.055)
    return np.where(clipped <= TOE, np.float32(12.92) * clipped, curved)


def palette(count: int) -> np.ndarray:
    """The colors (count + 1, 3) float32 of the numbers from 0 to `count`. 0 is the background, which is black.

    There can be more numbers than names: a linked object may have the name of a local one.
    """
    return np.array([(0.0, 0.0, 0.0), *map(color, range(count))], np.float32)


def color(number: int) -> tuple[float, float, float]:
    """A color for each number from 0, none of them black."""
    return colorsys.hsv_to_rgb(number * GOLDEN % 1.0, 0.65 + 0.35 * (number // 7 % 2), 1.0 - 0.3 * (number // 14 % 2))


def _range(texels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest value of each channel, (3,) each, where alpha is above 0."""
    known = texels[texels[..., 3] > 0.0][:, :3]
    return (known.min(axis=0), known.max(axis=0)) if len(known) else (np.zeros(3), np.zeros(3))
