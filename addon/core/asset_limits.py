# SPDX-License-Identifier: GPL-3.0-or-later
"""What a game asset shall be, as plain data."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

from .declarations.choices import Symmetry
from .errors import BakeError
from .simplify import LEAST, Limit

TRIANGLES = 5000
"""How many triangles a low mesh has if nothing else is said."""
CRUMBS, HOLES = 1, 2
"""Percent of the size below which parts are left out, and below which holes are filled, if nothing else is said."""
MOST_MENDED = 0.25
"""The largest share of the size that these may be."""
AUTO = "auto"
"""The word for maps as large as the detail needs."""
A_METER = "/m"
"""What follows a number of texels a meter."""
SIZES = 256, 4096
"""The smallest and the largest map that a size found by itself can have."""


OFF = 0.02
"""The share by which a number of triangles may be missed."""
STAGES = ("read", "decimate", "unwrap", "draw", "look")
"""Of making a low mesh, in the order in which a report lists them."""
LIMIT_MARGIN = 0.97
"""The share of a limit in degrees that meshes of a search keep: the UV map of the finished one differs from theirs."""
MOST_LEVELS = 8
"""The most levels of detail of an asset."""


@dataclass(frozen=True)
class Mending:
    """What is mended of a high surface before low meshes are made of it.

    Attributes:
        crumbs: The share of the size of the largest part below which parts are left out; 0 for none.
        holes: The share of that size below which holes are filled; 0 for none.
        symmetry: Along which axis low meshes equal their mirror images, if the surface does.
    """

    crumbs: float = CRUMBS / 100.0
    holes: float = HOLES / 100.0
    symmetry: Symmetry = Symmetry.AUTO

    @classmethod
    def of_texts(cls, crumbs: str, holes: str, symmetry: str = Symmetry.AUTO) -> "Mending":
        """Percents in texts, each of which may be empty. Raises BakeError."""
        return cls(_share(crumbs), _share(holes), Symmetry(symmetry.upper()))

    def check(self) -> None:
        """Raise BakeError for sizes that no part can have."""
        for name, share in (("Crumbs", self.crumbs), ("Holes", self.holes)):
            if not 0.0 <= share <= MOST_MENDED:
                raise BakeError(f"{name} of {100.0 * share:g} % are not small: give 0 to {100.0 * MOST_MENDED:g}.")


USUAL_MENDING = Mending()
"""What is mended if nothing else is said."""


@dataclass(frozen=True)
class Wanted:
    """The limits of an asset.

    Attributes:
        degrees: The shading error that 99 % of the pixels may have, infinite for no limit.
        distance: From the high mesh, that 99 % of the surface may have, as a share of the longest side of the box; infinite for
            no limit.
        triangles: How many the low mesh has; with another limit the most of them, 0 for as many as that takes.
        fits_size: Whether the maps are as large as the detail of the high objects needs.
        levels: How many levels of detail follow the low mesh.
        density: The texels a meter that the maps have at least; 0 for the size in the settings.
        is_count_given: Whether the user gave the number of triangles, and not the default, which is a most.
        mending: Of the high surface.
        owns_textures: Whether each level has UVs and textures of its own, and not those of the low mesh.
        quads: Whether low meshes are of quads.
        keeps: Whether the high mesh itself gets UVs and maps, and no low one is made.
        stacks_mirrored: Whether mirrored and equal parts share their place in the UV map.
        density_group: The vertex group whose weights scale the texel density of UV islands; empty for none.
    """

    degrees: float = math.inf
    triangles: int = TRIANGLES
    fits_size: bool = False
    distance: float = math.inf
    levels: int = 0
    density: float = 0.0
    is_count_given: bool = True
    mending: Mending = USUAL_MENDING
    owns_textures: bool = False
    keeps: bool = False
    stacks_mirrored: bool = False
    quads: bool = False
    density_group: str = ""

    @classmethod
    def of_texts(
        cls,
        degrees: str,
        triangles: str,
        size: str,
        distance: str = "",
        levels: int = 0,
        *,
        is_count_given: bool = True,
        mending: Mending = USUAL_MENDING,
        owns_textures: bool = False,
        keeps: bool = False,
        stacks_mirrored: bool = False,
        quads: bool = False,
        density_group: str = "",
    ) -> "Wanted":
        """The limits in texts, each of which may be empty. size: AUTO, texels a meter with A_METER, or anything else.
        distance: in percent. Raises BakeError."""
        most = _number(triangles, "a number of triangles") if triangles.strip() else 0.0
        if triangles.strip() and not most >= LEAST:
            raise BakeError(f"{triangles.strip()} is too few triangles, which enclose nothing: give {LEAST} or more.")
        angle = _number(degrees, "degrees") if degrees.strip() else math.inf
        percent = distance.strip().removesuffix("%")
        far = _number(percent, "a distance in percent") / 100.0 if percent else math.inf
        if min(angle, far) == math.inf and not triangles.strip():
            most = TRIANGLES
        word = size.strip().lower()
        density = _number(word.removesuffix(A_METER), "a number of texels a meter") if word.endswith(A_METER) else 0.0
        if word.endswith(A_METER) and not density > 0.0:
            raise BakeError(f"{density:g} texels a meter show nothing: give a number above 0.")
        is_count_given = is_count_given and bool(triangles.strip())
        limits = angle, round(most), word == AUTO, far, levels, density, is_count_given
        result = cls(*limits, mending, owns_textures, keeps, stacks_mirrored, quads, density_group)
        result.check()
        return result

    @property
    def own_levels(self) -> int:
        """How many levels of detail have textures of their own."""
        return self.levels if self.owns_textures else 0

    @property
    def finds_size(self) -> bool:
        """Whether the maps are as large as the low mesh asks, and not as the settings say."""
        return self.fits_size or self.density > 0.0

    @property
    def search_limit(self) -> Limit:
        """What the meshes of a search may deviate."""
        return Limit(LIMIT_MARGIN * self.degrees, self.distance)

    @property
    def has_count(self) -> bool:
        """Whether the number of triangles is what decides."""
        return min(self.degrees, self.distance) == math.inf

    def has_missed(self, triangles: int) -> bool:
        """Whether a low mesh of this many triangles has not the number that was wanted. Closed ones have no odd numbers."""
        over = triangles - self.triangles
        return self.has_count and (abs(over) if self.is_count_given else over) > max(1.0, OFF * self.triangles)

    def of_level(self, level: int, before: int) -> "Wanted":
        """The limits of a level of detail, where 0 is the low mesh itself. Each one has half the triangles of the level before
        it, or twice its degrees and its distance. before: the triangles of that level."""
        if not level:
            return self
        most = max(LEAST, before // 2 if self.has_count else before)
        return replace(self, degrees=self.degrees * 2**level, distance=self.distance * 2**level, triangles=most)

    def check(self) -> None:
        """Raise BakeError for limits that no mesh can have."""
        self.mending.check()
        if self.quads and len(self.mending.symmetry.axes) == 1:
            raise BakeError("Quads are not made symmetric: turn Quads or Symmetry off.")
        if not self.degrees > 0.0:
            raise BakeError(f"{self.degrees:g} degrees cannot be a limit: give a number above 0.")
        if not self.distance > 0.0:
            raise BakeError(f"{100.0 * self.distance:g} % of the size cannot be a limit: give a number above 0.")
        if self.triangles and self.triangles < LEAST:
            raise BakeError(f"{self.triangles} is too few triangles, which enclose nothing: give {LEAST} or more.")
        if not self.triangles and self.has_count:
            raise BakeError("No limit is set: give degrees, a distance, or a number of triangles.")
        if not 0 <= self.levels <= MOST_LEVELS:
            raise BakeError(f"{self.levels} levels of detail are not possible: give 0 to {MOST_LEVELS}.")

    def to_dict(self) -> dict[str, float | int]:
        """The limits that are set, as plain data."""
        values = {"degrees": self.degrees, "distance": self.distance, "triangles": self.triangles}
        return {name: value for name, value in values.items() if 0 < value < math.inf}


@dataclass(frozen=True)
class HowMade:
    """How the low mesh of a game asset was made, as Report.asset has it. None stands for what does not apply."""

    is_made: bool
    """Whether the low mesh is new, or was there."""
    is_remeshed: bool | None = None
    """Whether it is made of voxels."""
    is_collapsed: bool | None = None
    """Whether the last edges collapsed by quadrics."""
    keeps_planes: bool | None = None
    """Whether planes and straight edges of a hard surface are kept."""
    of: int | None = None
    """The triangles of the high meshes."""
    inside: float | None = None
    """The share of their area that sees nothing of the outside."""
    faults: float | None = None
    """The share of edges of more than two triangles, or of two that point to different sides."""
    crumbs: int | None = None
    """The parts that were too small to be kept."""
    holes: int | None = None
    """The holes that were filled."""
    shares: str | None = None
    """The low object whose UVs and textures it has."""
    symmetry: str | None = None
    """The axis along which it equals its mirror image: X, Y or Z."""
    measured: int | None = None
    """How many low meshes were compared."""
    limits: dict[str, float] | None = None
    """Those that are set: degrees, distance, triangles."""
    unwrapped: str = ""
    """A sentence about the new UV map; empty for one that was there."""
    missed: list[str] = field(default_factory=list)
    """A sentence for each limit that it does not keep."""
    distance: float | None = None
    """From the high mesh, if that has a limit."""
    seconds: dict[str, float] | None = None
    """Of each stage before the bakes, and their total, in the report of the first low mesh."""

    def to_dict(self) -> dict[str, Any]:
        """Plain data, without what does not apply."""
        return {name: value for name, value in vars(self).items() if value is not None}


def _share(percent: str) -> float:
    """The share that a text in percent stands for; 0 for an empty one."""
    text = percent.strip().removesuffix("%").strip()
    return _number(text, "a size in percent") / 100.0 if text else 0.0


def _number(text: str, what: str) -> float:
    try:
        number = float(text)
    except ValueError as error:
        raise BakeError(f"{text!r} is not {what}: give a number.") from error
    if not math.isfinite(number):
        raise BakeError(f"{text!r} is not {what}: give a number.")
    return number


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
