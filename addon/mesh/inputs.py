# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes of one bake."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ..core.material_feeds import ExactFeed, HighMaterial, ImagePixels
from ..core.parts_turned import PartTurned
from .triangle_mesh import MaybeArray, Mesh

LoadImage = Callable[[str, int], ImagePixels]


@dataclass(frozen=True)
class HitsOfFeed:
    """Hits on the triangles of one mesh whose value an ExactFeed has.

    number: of the high object, from 1. triangles (N,) int: in the mesh. weights (N, 3) float32: of the corners of each of them,
    in the order of `mesh.triangles`.
    """

    feed: ExactFeed
    mesh: Mesh
    number: int
    triangles: np.ndarray
    weights: np.ndarray


Evaluate = Callable[[Sequence[HitsOfFeed]], list[np.ndarray]]
"""Returns the values (N, 3) float32 at the hits of each."""


def _no_image(key: str, _tile: int) -> ImagePixels:
    raise LookupError(key)


def _no_values(wanted: Sequence[HitsOfFeed]) -> list[np.ndarray]:
    raise LookupError(wanted[0].feed.socket)


@dataclass(frozen=True)
class Mended:
    """What was changed of the high meshes after they were read.

    turned: for each mesh, which of its triangles (T,) bool were turned over; None for none. kept: for each mesh, which of them
    (T,) bool are left; None for all. parts: the number of connected parts that have turned triangles, of_parts: of all.
    of_triangles: the number of triangles that there were. undecided: for each mesh, the number of parts whose outer side is not
    known, and undecided_share: of the area of all meshes that they have. contradicting: for each mesh, the number of parts that
    cannot point to one side, as a Möbius strip. hidden: the number of triangles left out since they lie behind the surface,
    twice: since they are there twice. degrees: by how much normals were smoothed, in the median and at the 95th percentile, or
    empty. low_differs: whether the faces of the low mesh itself point to different sides, so that it cannot tell.
    low_is_inside_out: whether the low mesh is closed, and all of it points inward. largest: of the parts that were turned over,
    those with most triangles.
    """

    turned: tuple[MaybeArray, ...] = ()
    kept: tuple[MaybeArray, ...] = ()
    parts: int = 0
    of_parts: int = 0
    of_triangles: int = 0
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
        return cls((None,) * len(highs), of_triangles=sum(len(high.triangles) for high in highs))

    @property
    def turned_of_kept(self) -> list[MaybeArray]:
        """`turned` of the triangles that are left of each mesh, (N,) bool."""
        kept = self.kept or [None] * len(self.turned)
        return [
            mask if mask is None or some is None else mask[some] for mask, some in zip(self.turned, kept, strict=True)
        ]

    def largest_to_dicts(self) -> list[dict[str, Any]]:
        """`largest`, as core.report.Report has it."""
        return list(map(asdict, self.largest))

    def to_dict(self) -> dict[str, float]:
        """The numbers, as core.report.Report has them."""
        numbers = {
            "turned": sum(int(np.count_nonzero(mask)) for mask in self.turned if mask is not None),
            "of": self.of_triangles,
            "parts": self.parts,
            "of_parts": self.of_parts,
            "undecided": sum(self.undecided),
            "hidden": self.hidden,
            "twice": self.twice,
        }
        return numbers | dict(zip(("smoothed_median", "smoothed_percentile_95"), self.degrees, strict=False))


@dataclass(frozen=True)
class Meshes:
    """All meshes that a bake reads: of the low-poly object ("low"), of the high-poly objects ("high") and of the cage.

    low: the low mesh with its faces, for rays and checks. basis: the low mesh with tangents for tangent space, else None.
    smooth_normals (C, 3) float32: vertex normals by corner of `low`, without hard edges. cage: a mesh with the corners of
    `low`, or None. is_own_base: whether the high mesh is the low object's own surface with modifiers. materials: those behind
    the material labels of the high meshes, which count from 1. others: the high meshes of other low objects, if they are
    occluders. load_image: loads the pixels of an image of the materials, by its key and its UDIM tile (0 without tiles).
    evaluate: the values of materials at hits, by Cycles.
    whole, kept, material: for a texture set, `low` has only the triangles of one material; then the low mesh with all of them,
    the indices of those that were kept, and the material's name. shown: with is_own_base, the high mesh with the UVs that
    modifiers moved, as the viewport shows it; None if no modifier moves UVs. lacks: what the objects lack, in sentences.
    is_reversed: whether `highs` are in the reverse order of the objects, so that Flatten draws the first one last. mended: what
    was changed of them after they were read; None if nothing was.

    Painted by corner of `low`, (C,) float32, or None without a painted group. offset: factors from 0 to 2 on the extrusion.
    straight: from -1 to 1, added to the share of the mesh's own normals in the directions.
    """

    low: Mesh
    highs: list[Mesh]
    basis: Mesh | None
    smooth_normals: np.ndarray
    cage: Mesh | None
    uv_layer: str
    is_own_base: bool
    materials: list[HighMaterial]
    shown: Mesh | None = None
    offset: np.ndarray | None = None
    straight: np.ndarray | None = None
    others: list[Mesh] = field(default_factory=list)
    load_image: LoadImage = _no_image
    evaluate: Evaluate = _no_values
    whole: Mesh | None = None
    kept: np.ndarray | None = None
    material: str = ""
    lacks: list[str] = field(default_factory=list)
    is_reversed: bool = False
    mended: Mended | None = None

    @classmethod
    def of(cls, low: Mesh, highs: list[Mesh]) -> "Meshes":
        """A low mesh with UVs and high meshes alone, for maps that are not in tangent space."""
        labeled = [
            replace(high, labels=np.tile(np.array([number, 0], np.float32), (len(high.triangles), 1)))
            for number, high in enumerate(highs, start=1)
        ]
        return cls(low, labeled, None, low.normals, None, "", is_own_base=False, materials=[])

    @property
    def listed_highs(self) -> list[Mesh]:
        """The high meshes in the order of the objects, for messages."""
        return self.highs[::-1] if self.is_reversed else self.highs

    @property
    def whole_low(self) -> Mesh:
        """The low mesh with all its triangles."""
        return self.low if self.whole is None else self.whole

    @property
    def drawn_highs(self) -> list[Mesh]:
        """The high meshes as Flatten draws them: for a texture set, only what has its material, where they have it."""
        if self.whole is None:
            return self.highs
        return [high.with_triangles(mask) for high, mask in zip(self.highs, self._drawn, strict=True)]

    @property
    def is_drawn(self) -> np.ndarray | None:
        """Which triangles of the high meshes (T,) bool, mesh after mesh, Flatten draws; None for all."""
        return None if self.whole is None else np.concatenate(self._drawn)

    @property
    def _drawn(self) -> list[np.ndarray]:
        numbers = [number for number, one in enumerate(self.materials, start=1) if one.name == self.material]
        return [_with_labels(high, numbers) for high in self.highs]

    @property
    def has_detail(self) -> bool:
        """Whether a material of the high meshes moves normals."""
        return any(material.detail is not None for material in self.materials)


def _with_labels(high: Mesh, numbers: list[int]) -> np.ndarray:
    """Which triangles of `high` (T,) bool have one of these materials; all if none has."""
    found = np.isin(high.labels[:, 1], numbers)
    return found if found.any() else ~found
