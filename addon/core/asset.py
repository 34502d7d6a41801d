# SPDX-License-Identifier: GPL-3.0-or-later
"""What a game asset shall be, as plain data."""

import math
from dataclasses import dataclass

from .errors import BakeError
from .levels import LEAST

TRIANGLES = 5000
"""How many triangles a low mesh has if nothing else is said."""
AUTO = "auto"
"""The word for maps as large as the detail needs."""
SIZES = 256, 4096
"""The smallest and the largest map that a size found by itself can have."""


@dataclass(frozen=True)
class Wanted:
    """The limits of an asset.

    degrees: the shading error that 99 % of the pixels may have, infinite for no limit. triangles: how many the low mesh has;
    with a limit in degrees the most of them, 0 for as many as that takes. fits_size: whether the maps are as large as the
    detail of the high objects needs.
    """

    degrees: float = math.inf
    triangles: int = TRIANGLES
    fits_size: bool = False

    @classmethod
    def of_texts(cls, degrees: str, triangles: str, size: str) -> "Wanted":
        """The limits in texts, each of which may be empty. size: AUTO, or anything else. Raises BakeError."""
        most = _number(triangles, "a number of triangles") if triangles.strip() else 0.0
        if triangles.strip() and not most >= LEAST:
            raise BakeError(f"{triangles.strip()} triangles enclose nothing: give {LEAST} or more.")
        angle = _number(degrees, "degrees") if degrees.strip() else math.inf
        if angle == math.inf and not triangles.strip():
            most = TRIANGLES
        result = cls(angle, round(most), size.strip().lower() == AUTO)
        result.check()
        return result

    def check(self) -> None:
        """Raise BakeError for limits that no mesh can have."""
        if not self.degrees > 0.0:
            raise BakeError(f"{self.degrees:g} degrees cannot be a limit: give a number above 0.")
        if self.triangles and self.triangles < LEAST:
            raise BakeError(f"{self.triangles} triangles enclose nothing: give {LEAST} or more.")
        if not self.triangles and self.degrees == math.inf:
            raise BakeError("No limit is set: give degrees, or a number of triangles.")


def _number(text: str, what: str) -> float:
    try:
        found = float(text)
    except ValueError as error:
        raise BakeError(f"{text!r} is not {what}: give a number.") from error
    if not math.isfinite(found):
        raise BakeError(f"{text!r} is not {what}: give a number.")
    return found


def size_for(texel: float, area: float, used: float) -> int:
    """The side of a square map in texels, a power of two within SIZES.

    Args:
        texel: the side that a texel has on the surface at most, in any unit of length.
        area: of the low mesh, in the square of that unit.
        used: the share of the map that its UVs take.
    """
    if not (texel > 0.0 and area > 0.0 and used > 0.0):
        return SIZES[0]
    side = math.sqrt(area / used) / texel
    return int(min(max(2 ** math.ceil(math.log2(max(side, 1.0))), SIZES[0]), SIZES[1]))
