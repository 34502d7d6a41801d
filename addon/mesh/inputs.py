# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes of one bake."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.material_feeds import ExactFeed, HighMaterial, ImagePixels
from ..core.settings import Settings
from .tiling import Repeat
from .triangle_mesh import Mesh

LoadImage = Callable[[str, int], ImagePixels]


@dataclass(frozen=True)
class HitsOfFeed:
    """Hits on the triangles of one mesh whose value an ExactFeed has.

    Attributes:
        feed: what has the value.
        mesh: the high mesh.
        number: of the high object, from 1.
        triangles: (N,) int, in the mesh.
        weights: (N, 3) float32, of the corners of each of them, in the order of `mesh.triangles`.
        spacing: (N,) float32, how far the texels beside are, in world space; 0 where none is. Empty if the feed has no bumps.
    """

    feed: ExactFeed
    mesh: Mesh
    number: int
    triangles: np.ndarray
    weights: np.ndarray
    spacing: np.ndarray = field(default_factory=lambda: np.empty(0, np.float32))

    def part(self, some: slice) -> "HitsOfFeed":
        """Some of the hits."""
        return replace(self, triangles=self.triangles[some], weights=self.weights[some], spacing=self.spacing[some])


Evaluate = Callable[[Sequence[HitsOfFeed]], list[np.ndarray]]
"""Returns the values (N, 3) float32 at the hits of each."""


def _no_image(key: str, _tile: int) -> ImagePixels:
    raise LookupError(key)


def _no_values(wanted: Sequence[HitsOfFeed]) -> list[np.ndarray]:
    raise LookupError(wanted[0].feed.socket)


@dataclass(frozen=True)
class Meshes:
    """All meshes that a bake reads: of the low-poly object ("low"), of the high-poly objects ("high") and of the cage.

    Attributes:
        low: the low mesh with its faces, for rays and checks; of a texture set, only the triangles of one material.
        highs: the high meshes.
        basis: the low mesh with tangents for tangent space, else None.
        smooth_normals: (C, 3) float32, vertex normals by corner of `low`, without hard edges.
        cage: a mesh with the corners of `low`, or None.
        uv_layer: the name of the low mesh's UV map.
        is_own_base: whether the high mesh is the low object's own surface with modifiers.
        materials: those behind the material labels of the high meshes, which count from 1.
        parts: the names behind the part labels of the high meshes, which count from 1.
        shown: with is_own_base, the high mesh with the UVs that modifiers moved, as the viewport shows it; None if none does.
        offset: (C,) float32, painted factors from 0 to 2 on the extrusion by corner of `low`; None without a painted group.
        straight: (C,) float32, painted from -1 to 1, added to the share of the mesh's own normals in the directions; or None.
        others: meshes of other objects that are occluders.
        load_image: loads the pixels of an image of the materials, by its key and its UDIM tile (0 without tiles).
        evaluate: the values of materials at hits, by Cycles.
        whole: for a texture set, the low mesh with all its triangles.
        kept: for a texture set, the indices of those of `whole` that were kept.
        material: for a texture set, the material's name.
        lacks: what the objects lack, in sentences.
        is_reversed: whether `highs` are in the reverse order of the objects, so that Flatten draws the first one last.
        repeat: how all meshes repeat where the map wraps around; None if it does not.
    """

    low: Mesh
    highs: list[Mesh]
    basis: Mesh | None
    smooth_normals: np.ndarray
    cage: Mesh | None
    uv_layer: str
    is_own_base: bool
    materials: list[HighMaterial]
    parts: list[str] = field(default_factory=list)
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
    repeat: Repeat | None = None

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

    @property
    def has_cutouts(self) -> bool:
        """Whether a material of the high meshes may be clear somewhere."""
        return any(material.cutout is not None for material in self.materials)

    def turns_normals(self, settings: Settings) -> bool:
        """Whether the normals at hits are not those of the high meshes: their materials move them, or edges are rounded."""
        return self.has_detail or settings.map.edge_radius > 0.0


def _with_labels(high: Mesh, numbers: list[int]) -> np.ndarray:
    """Which triangles of `high` (T,) bool have one of these materials; all if none has."""
    is_chosen = np.isin(high.labels[:, 1], numbers)
    return is_chosen if is_chosen.any() else ~is_chosen
