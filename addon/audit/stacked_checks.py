# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks parts of the low mesh that share texels: whether what the map shows there is also theirs, detail and materials."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..core.declarations.choices import Space
from ..core.errors import UNWRAPS, Fix, shorten_list
from ..core.map_types import BY_NAME, Labeled
from ..core.material_feeds import HighMaterial
from ..core.sentences import LOOK, WRONG, Sentence
from ..core.settings import MapSettings, Settings
from ..engine.baking import Drawing
from ..engine.bands import Band
from ..engine.sampling import SampledMaps
from ..engine.stacked_uvs import StackedParts
from ..mesh.triangle_mesh import Mesh
from ..passes import cast, target
from . import severity
from .severity import MUCH_OVERLAP, Check

STACKED_SIDE = 256
"""Texels a side, at most, on which parts are compared."""
DIFFERENT = 2.0
"""Degrees, in tangent space, above which parts do not have the same detail."""


def check_stacked(
    hidden: StackedParts, drawn: Drawing, settings: Settings, materials: np.ndarray | None = None
) -> Check:
    """What Report.checks has of hidden parts, for the check "overlap". drawn: the bake, with own hits. materials (T,) int: the
    number of each low triangle's material; None to leave them out."""
    counts = {"hidden": 0, "under_others": 0, "differing": 0.0, "other_material": 0.0, "materials": []}
    if not hidden.are_many(MUCH_OVERLAP):  # decimation leaves slivers on other triangles
        return counts
    counts["hidden"] = hidden.triangles
    # Each part has other normals in other spaces.
    has_normals = settings.map.space == Space.TANGENT and settings.map.normal
    of_high = drawn.plan.meshes.materials
    looks = None if drawn.source.surface is None else _looks(of_high, settings.map)
    if not has_normals and looks is None:
        return counts
    if materials is not None:
        counts["under_others"] = hidden.under_others(materials)
    sums = _Sums(has_normals, looks)
    size = min(settings.sampling.width, STACKED_SIDE), min(settings.sampling.height, STACKED_SIDE)
    with target.using(target.TargetPool()):
        for tile in drawn.plan.tiles:
            sums.add(hidden, drawn.maps, Band(0, size[1], size, 0, tile))
    return counts | {
        "differing": sums.differing / max(1, sums.compared),
        "other_material": sums.others / max(1, sums.covered),
        "materials": [of_high[number - 1].name for number in sorted(sums.materials)],
    }


def warnings(low: Mesh, stacked: Check) -> Iterator[Sentence]:
    """What is wrong with parts of `low` that share texels. stacked: of `check_stacked`."""
    are_others = stacked["under_others"] > 0.5 * stacked["hidden"]
    if stacked["other_material"] > MUCH_OVERLAP:
        text = (
            f"{stacked['other_material']:.1%} of the texels of {low.name!r} belong to faces of different materials "
            f"({shorten_list(map(repr, stacked['materials']))}), and the maps show one of them: {UNWRAPS}."
        )
        text = Fix.TEXTURE_SETS.after(text) if are_others else text
        yield Sentence(text, WRONG, severity.MATERIALS, stacked["other_material"])
    elif stacked["differing"] <= severity.MANY_DIFFERENT:
        return
    elif are_others:
        text = f"Materials of {low.name!r} share UVs, and its map has the detail of one of them."
        yield Sentence(Fix.TEXTURE_SETS.after(text), WRONG, severity.MATERIALS, stacked["differing"])
    else:
        yield Sentence(
            f"{stacked['hidden']:,} triangles of {low.name!r} show the detail of other parts with the same UVs, and on "
            f"{stacked['differing']:.1%} of their texels it is more than {DIFFERENT:.0f} degrees from their own. "
            "If they need it, Unwrap without Stack Mirrored gives them UVs of their own.",
            LOOK,
            severity.OTHER_DETAIL,
            stacked["differing"],
        )


def _looks(materials: Sequence[HighMaterial], map_settings: MapSettings) -> np.ndarray | None:
    """A number (M + 1,) int for each material number of the high meshes, the same for those that look alike on all maps of
    materials; None without such maps. 0 is no material."""
    drawn = [BY_NAME[name] for name in map_settings.drawn_maps]
    sockets = [one.socket for one in drawn if one.socket]
    is_numbered = any(one.labeled is Labeled.MATERIALS for one in drawn)
    if not (sockets or is_numbered):
        return None
    numbers: dict[tuple, int] = {}
    looks = np.zeros(len(materials) + 1, np.int64)
    for number, material in enumerate(materials, start=1):
        look = (*(material.feeds.get(socket) for socket in sockets), number if is_numbered else 0)
        looks[number] = numbers.setdefault(look, len(numbers) + 1)
    return looks


@dataclass(frozen=True)
class _Shown:
    """The high surface on a band.

    Attributes:
        normals (height, width, 3): In tangent space.
        is_known (height, width) bool: Where it was hit.
        materials (height, width) int: The numbers of its materials; 0 for none.
    """

    normals: np.ndarray
    is_known: np.ndarray
    materials: np.ndarray

    @classmethod
    def on(cls, maps: SampledMaps, band: Band, *, has_materials: bool) -> "_Shown":
        """What some maps show."""
        texels = np.empty((band.height, band.width, 4), np.float32)
        target.read(maps.space.of_sample(maps.high_normals(band), band), texels)
        materials = np.zeros(texels.shape[:2], np.int64)
        if has_materials and maps.source.surface is not None:
            triangles, _ = cast.read_hits(maps.source.hits(band))
            is_hit = triangles >= 0
            materials[is_hit] = maps.source.surface.material_numbers[triangles[is_hit]]
        return cls(texels[..., :3], texels[..., 3] > 0.0, materials)


@dataclass
class _Sums:
    """Counts of texels.

    Attributes:
        has_normals: Whether normals are compared.
        looks: From `_looks`; None to leave materials out.
        compared, differing: Of all layers, those whose normals were compared, and those that differ.
        covered, others: Of the map, those that it shows, and those where a layer has a material that looks different.
        materials: The numbers of these materials, from 1.
    """

    has_normals: bool
    looks: np.ndarray | None
    compared: int = 0
    differing: int = 0
    covered: int = 0
    others: int = 0
    materials: set[int] = field(default_factory=set)

    def add(self, hidden: StackedParts, maps: SampledMaps, band: Band) -> None:
        """Compare what the map shows on a band with each hidden layer."""
        has_materials = self.looks is not None
        top = _Shown.on(maps, band, has_materials=has_materials)
        is_other = np.zeros(top.is_known.shape, bool)
        for layer in hidden.layers:
            own = _Shown.on(layer.maps, band, has_materials=has_materials)
            both = own.is_known & top.is_known & hidden.is_hidden(layer, band)
            if self.has_normals:
                cosines = (top.normals[both] * own.normals[both]).sum(axis=1)
                self.compared += len(cosines)
                self.differing += int(np.count_nonzero(cosines < np.cos(np.radians(DIFFERENT))))
            if self.looks is not None:
                here = both & (self.looks[top.materials] != self.looks[own.materials])
                is_other |= here
                self.materials.update(top.materials[here].tolist(), own.materials[here].tolist())
        self.covered += int(np.count_nonzero(top.is_known))
        self.others += int(np.count_nonzero(is_other))
