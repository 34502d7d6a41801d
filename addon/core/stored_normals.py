# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversions of normal maps, as plain data: what a stored map means, what its channels hold, and the report."""

from dataclasses import dataclass, field, fields, replace
from typing import ClassVar

import numpy as np

from .declarations import bases
from .declarations.all_settings import DECLARED
from .declarations.choices import Space
from .errors import BakeError, Length, plain_length
from .report import Report
from .settings import MapSettings


@dataclass(frozen=True)
class StoredNormals:
    """The space, the tangent basis and the channels of a normal map that is read. See CONVERT in the declarations."""

    from_space: str = DECLARED["from_space"].default
    from_basis: str = DECLARED["from_basis"].default
    from_red: str = DECLARED["from_red"].default
    from_green: str = DECLARED["from_green"].default
    from_blue: str = DECLARED["from_blue"].default

    def read_by(self, engine: str) -> "StoredNormals":
        """The same, where basis AUTO is replaced by that of a render engine. engine: Blender's identifier."""
        if self.from_basis != bases.AUTO:
            return self
        return replace(self, from_basis=bases.of_engine(engine).name)

    @property
    def channels(self) -> MapSettings:
        """Map settings with these channels."""
        return MapSettings(red=self.from_red, green=self.from_green, blue=self.from_blue)

    def check(self) -> None:
        """Raise BakeError for values that are not valid."""
        for name in (each.name for each in fields(self)):
            DECLARED[name].check(getattr(self, name))
        axes = self.from_red, self.from_green, self.from_blue
        if len({axis[1] for axis in axes}) < 3:
            raise BakeError(
                f"Red, green and blue of the map to convert are {', '.join(axes)}: give each channel another axis."
            )

    @property
    def words(self) -> str:
        """The space, and the basis and the channels where they matter."""
        return in_words(self.from_space, self.from_basis, (self.from_red, self.from_green, self.from_blue))


def in_words(space: str, basis: str, axes: tuple[str, str, str]) -> str:
    """A space of normals in words, with the tangent basis, and with the axes of the channels if they are unusual."""
    details = [bases.of_name(basis).label] if space == Space.TANGENT else []
    details += [", ".join(axes)] if axes != ("+X", "+Y", "+Z") else []
    return f"{space.lower()} space" + (f" ({'; '.join(details)})" if details else "")


STEP_OF_8_BITS = 1.0 / 255.0
"""Of 8 bits. Compression and rounding move values by about one."""
MOST_BETWEEN = 0.25
"""The share of texels with some alpha whose alpha may be less than 1 in a map of coverage: the smooth borders of islands."""
LEAST_Z = 0.5
"""The median of a tangent-space map's z, at least. Red and green that give less are no x and y."""


def is_coverage(texels: np.ndarray) -> bool:
    """Whether alpha says where the map is. Otherwise it holds other data, as gloss or height. texels: (N, 4) of the map."""
    has_some = texels[:, 3] > 0.5 * STEP_OF_8_BITS
    between = np.count_nonzero(has_some & (texels[:, 3] < 1.0 - 0.5 * STEP_OF_8_BITS))
    return bool(between <= MOST_BETWEEN * np.count_nonzero(has_some))


def lacks_z(texels: np.ndarray, stored: StoredNormals) -> bool:
    """Whether a tangent-space map has x and y alone: the third channel is the same everywhere. texels: (N, 4) of the map."""
    channel, _ = _z_channel(stored)
    known = texels[texels[:, 3] > 0.0]
    if stored.from_space != Space.TANGENT or not len(known) or np.ptp(known[:, channel]) > 1.5 * STEP_OF_8_BITS:
        return False
    z = _z(known, channel)
    off = np.abs(_as_stored(z, stored) - known[:, channel])
    return bool(np.median(z) > LEAST_Z and off.max() > 2.5 * STEP_OF_8_BITS)


def rebuild_z(values: np.ndarray, stored: StoredNormals) -> None:
    """Fill the channel of z in `values` (..., 4) from x and y, so that normals have length 1 and point up."""
    channel, _ = _z_channel(stored)
    values[..., channel] = _as_stored(_z(values, channel), stored)


def z_channel(stored: StoredNormals) -> str:
    """The name of the channel that stores z."""
    return ("red", "green", "blue")[_z_channel(stored)[0]]


def _z_channel(stored: StoredNormals) -> tuple[int, float]:
    """The number of the channel that stores z, and its sign."""
    axes = [stored.from_red, stored.from_green, stored.from_blue]
    channel = next(number for number, axis in enumerate(axes) if axis[1] == "Z")
    return channel, -1.0 if axes[channel][0] == "-" else 1.0


def _as_stored(z: np.ndarray, stored: StoredNormals) -> np.ndarray:
    return z * np.float32(0.5 * _z_channel(stored)[1]) + np.float32(0.5)


def _z(values: np.ndarray, channel: int) -> np.ndarray:
    """The z of normals whose x and y are in the other two of the first three channels."""
    flat = sum(np.square(values[..., other] * 2.0 - 1.0) for other in range(3) if other != channel)
    return np.sqrt(np.maximum(1.0 - flat, 0.0))


CLOSE = 1e-6
"""How near a value must be to a multiple of a step. Steps of 16 bits are 15 times as large."""


def bits(values: np.ndarray) -> int:
    """8 or 16 if all values are multiples of those steps from 0 to 1, else 32. values: of any shape, float32."""
    for depth in (8, 16):
        scaled = values.astype(np.float64) * (2**depth - 1)
        if (np.abs(scaled - np.rint(scaled)) <= CLOSE * (2**depth - 1)).all():
            return depth
    return 32


def moved(values: np.ndarray, depth: int, seed: int = 0) -> np.ndarray:
    """Values (N, n) that would have been rounded to `values`, float32, drawn at random, the same ones for each call."""
    step = 1.0 / (2**depth - 1)
    return (values + np.random.default_rng(seed).uniform(-0.5 * step, 0.5 * step, values.shape)).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class ConversionReport(Report):
    """The results of the conversion of a map."""

    method: str = "CONVERT"
    space: str = ""
    high: list[str] = field(default_factory=list)
    """Names of high objects: none."""
    source: str
    """The name of the image that was converted."""
    before: dict[str, str]
    """What the source means, by the names in StoredNormals."""
    was: str
    """The space of the source, in words."""
    now: str
    """The space of the new map, in words."""
    source_depth: int
    """Bits per channel that the values of the source need: 8 or 16, or 32 for floats."""
    source_loss: dict[str, float]
    """Degrees that the rounding of the source may have cost: median and maximum. Empty for floats."""
    KEYS: ClassVar = (
        *(
            "source",
            "low",
            "size",
            "before",
            "settings",
            "was",
            "now",
            "source_depth",
            "source_loss",
            "loss",
            "coverage",
        ),
        *("margin", "tiles", "uv_layer", "image", "output", "seconds", "mip_files", "memory", "maps", "warnings"),
        *("method", "export"),
    )
    """What its plain data have."""

    def with_startup(self, seconds: dict[str, float]) -> "ConversionReport":
        """The same report with the seconds before the work."""
        return replace(self, seconds={**self.seconds, **seconds})

    def to_dict(self) -> dict:
        """Plain data for json.dump."""
        values = super().to_dict()
        return {name: values[name] for name in self.KEYS}

    def summary(self, length: Length = plain_length) -> list[str]:
        """The report in lines."""
        width, height = self.size
        lines = [
            f"Converted {self.source} from {self.was} to {self.now}, {width} x {height}: {self.image}",
            f"{self.coverage:.1%} of the map covered",
        ]
        if self.source_loss:
            lines.append(f"The {self.source_depth} bits of {self.source}: {_degrees(self.source_loss)}")
        if self.loss:
            lines.append(f"Stored: {_degrees(self.loss)}")
        return [*lines, f"{self.seconds['total']:.2f} s"]


def _degrees(loss: dict[str, float]) -> str:
    return f"normals off by {loss['median']:.2g} degrees (median), at most {loss['maximum']:.2g}"
