# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake changes of its high meshes, as masks; the meshes that have these changes; and what is told of them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from ..core.parts_turned import PartTurned
from ..core.values import ComparedByValue
from ..mesh import corner_normals
from ..mesh.triangle_mesh import MaybeArray, Mesh
from .high_patches import places_of


@dataclass(frozen=True, eq=False)
class HighMasks(ComparedByValue):
    """What is changed of one high mesh. The masks (T,) bool are of its triangles as they were read; None for none of them.

    Attributes:
        copies: Left out before all else, since an earlier triangle is in the same place and points to the same side.
        turned: Turned over.
        left_out: All that are left out.
        is_joined: Whether normals become smooth across vertices that are at one place and not joined; where triangles are
            turned over, they do.
    """

    copies: MaybeArray = None
    turned: MaybeArray = None
    left_out: MaybeArray = None
    is_joined: bool = False

    @property
    def turned_of_kept(self) -> MaybeArray:
        """`turned` of the triangles that are not left out, (N,) bool."""
        return self.turned if self.turned is None or self.left_out is None else self.turned[~self.left_out]

    def of(self, high: Mesh) -> Mesh:
        """The mesh with these changes. It is made once."""
        once = without_copies(high, self.copies)
        if self.turned is not None:
            once = once.remembered("turned", (self.turned,), partial(self._turned, once))
        elif self.is_joined:
            once = joined(once)
        if self.left_out is None or self.left_out is self.copies:
            return once
        return once.remembered("kept", (self.left_out,), partial(self._kept, once))

    def _turned(self, once: Mesh) -> Mesh:
        mask = self.turned if self.copies is None else self.turned[~self.copies]
        return corner_normals.turned_over(once, mask, places_of(once))

    def _kept(self, once: Mesh) -> Mesh:
        return once.with_triangles(~self.left_out if self.copies is None else ~self.left_out[~self.copies])

    def of_all(self, copies: np.ndarray) -> "HighMasks":
        """These masks, of a mesh without copies (T,) bool, for the mesh with them."""
        if not copies.any():
            return self
        turned, left_out = (
            None if mask is None else _spread(mask, copies, of_copies)
            for mask, of_copies in ((self.turned, False), (self.left_out, True))
        )
        return HighMasks(copies, turned, copies if left_out is None else left_out, self.is_joined)


def _spread(mask: np.ndarray, copies: np.ndarray, of_copies: bool) -> np.ndarray:
    whole = np.full(len(copies), of_copies)
    whole[~copies] = mask
    return whole


def without_copies(high: Mesh, copies: np.ndarray | None) -> Mesh:
    """A mesh without some triangles (T,) bool, made once."""
    if copies is None or not copies.any():
        return high
    return high.remembered("without copies", (copies,), lambda: high.with_triangles(~copies))


def joined(high: Mesh) -> Mesh:
    """A mesh with smooth normals where vertices are at one place and not joined, made once."""

    def other() -> Mesh | None:
        made = corner_normals.joined(high, places_of(high))
        return None if made is high else made

    return high.remembered("joined", (), other) or high


@dataclass(frozen=True)
class Mended:
    """What is told of changes of the high meshes.

    Attributes:
        turned: How many triangles were turned over.
        of_triangles: Of how many.
        parts: In how many connected parts.
        of_parts: Of how many.
        undecided: For each mesh, the number of parts whose outer side is not known.
        undecided_share: Of the area of all meshes that they have.
        contradicting: For each mesh, the number of parts that cannot point to one side, as a Möbius strip.
        hidden: How many triangles were left out since they lie behind the surface.
        twice: How many since they are there twice.
        degrees: By how much normals were smoothed, in the median and at the 95th percentile, or empty.
        low_differs: Whether the faces of the low mesh itself point to different sides, so that it cannot tell.
        low_is_inside_out: Whether the low mesh is closed, and all of it points inward.
        largest: Of the parts that were turned over, those with most triangles.
    """

    turned: int = 0
    of_triangles: int = 0
    parts: int = 0
    of_parts: int = 0
    undecided: tuple[int, ...] = ()
    undecided_share: float = 0.0
    contradicting: tuple[int, ...] = ()
    hidden: int = 0
    twice: int = 0
    degrees: tuple[float, ...] = ()
    low_differs: bool = False
    low_is_inside_out: bool = False
    largest: tuple[PartTurned, ...] = ()

    @classmethod
    def nothing(cls, highs: Sequence[Mesh]) -> "Mended":
        """Nothing that was changed of these meshes."""
        return cls(of_triangles=sum(len(high.triangles) for high in highs))

    def largest_to_dicts(self) -> list[dict[str, Any]]:
        """`largest`, as core.report.Report has it."""
        return list(map(asdict, self.largest))

    def to_dict(self) -> dict[str, float]:
        """The numbers, as core.report.Report has them."""
        numbers = {
            "turned": self.turned,
            "of": self.of_triangles,
            "parts": self.parts,
            "of_parts": self.of_parts,
            "undecided": sum(self.undecided),
            "hidden": self.hidden,
            "twice": self.twice,
        }
        return numbers | dict(zip(("smoothed_median", "smoothed_percentile_95"), self.degrees, strict=False))
