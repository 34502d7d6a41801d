# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be said of a low mesh before it is baked, where another program than Blender reads the map."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.declarations import bases, readers
from ..core.declarations.choices import Space, Storage
from ..core.settings import MapSettings, SamplingSettings, Settings
from ..mesh import face_shapes, uv_islands, uv_layout, uv_seams
from ..mesh.triangle_mesh import Mesh
from . import facing, severity
from .facing import Faces

FLIPPED, POLYGONS, LAYER, HARD_EDGES, MIRRORED = "FLIPPED", "POLYGONS", "LAYER", "HARD_EDGES", "MIRRORED"
KINDS = (FLIPPED, POLYGONS, LAYER, HARD_EDGES, MIRRORED)

FACING = "The faces of {flipped} point to the other side than those of {other}: flip its normals before the bake."
N_GONS = (
    "{low} has {count:,} n-gons: exporters write no tangents for them, and other programs divide them into other triangles "
    "than this bake. Triangulate it before the bake."
)
QUADS = (
    "{low} has {count:,} quads that look different if another program divides them along the other diagonal. Triangulate it "
    "before the bake."
)
OTHER_LAYER = (
    "The map is for the UV map {layer} of {low}, but {active} is the active one: exporters write the tangents of the active "
    "one."
)
STACKED = (
    "{low} has {count:,} triangles that are mirrored onto others in UV space: the map shows the detail of one of the two. "
    "Moved by a whole tile, they read the detail of the others."
)
SENTENCES = (FACING, N_GONS, QUADS, OTHER_LAYER, severity.HARD_EDGES, STACKED)
"""All templates of Finding."""

_BLENDERS = {bases.of_engine("CYCLES"), bases.of_engine("BLENDER_EEVEE")}


@dataclass(frozen=True)
class Finding:
    """One of KINDS, with a sentence about it. template: one of SENTENCES. values: to fill in.

    harms: whether the map is wrong in another program.
    """

    kind: str
    template: str
    values: dict[str, Any]
    harms: bool = True

    @property
    def sentence(self) -> str:
        return self.template.format(**self.values)


def find_flipped(low: Faces, highs: Faces, low_name: str, high_names: str) -> list[Finding]:
    """A finding if the faces of the low object point against those of the high ones. The names are for the sentence."""
    if not facing.is_against(low, highs):
        return []
    is_high = facing.flipped_one(low, highs) == "high"
    flipped, other = (high_names, low_name) if is_high else (low_name, high_names)
    return [Finding(FLIPPED, FACING, {"flipped": flipped, "other": other, "is_high": is_high})]


def is_for_others(settings: Settings) -> bool:
    """Whether a program other than Blender reads the normal map, in tangent space. settings: AUTO is not yet replaced.

    MikkTSpace can be meant for EEVEE, too: it counts if it was chosen for a map that goes into a file.
    """
    if not is_in_tangent_space(settings.map):
        return False
    if settings.map.green == "-Y" or set(settings.map.readers) - readers.IN_BLENDER:
        return True
    if settings.map.basis == bases.AUTO:
        return False
    basis = bases.of_name(settings.map.basis)
    return basis not in _BLENDERS or (basis == bases.MIKKTSPACE and settings.storing.storage == Storage.FILE)


def is_in_tangent_space(settings: MapSettings) -> bool:
    """Whether a bake makes a tangent-space normal map."""
    return settings.normal and settings.space == Space.TANGENT


def find(low: Mesh, uv_layer: str, active_layer: str, settings: SamplingSettings) -> list[Finding]:
    """Look at a low mesh, which must have UVs and faces. uv_layer: of the map. active_layer: of the object."""
    name = repr(low.name)
    found = [_polygons(low, name)]
    if active_layer and uv_layer != active_layer:
        values = {"low": name, "layer": repr(uv_layer), "active": repr(active_layer)}
        found.append(Finding(LAYER, OTHER_LAYER, values))
    hard = len(uv_seams.hard_edges(low))
    if hard:
        found.append(Finding(HARD_EDGES, severity.HARD_EDGES, {"low": name, "count": hard}))
    if not settings.udim:
        stacked = int(np.count_nonzero(mirrored_copies(low)))
        if stacked:
            found.append(Finding(MIRRORED, STACKED, {"low": name, "count": stacked}, harms=False))
    return [finding for finding in found if finding is not None]


def _polygons(low: Mesh, name: str) -> Finding | None:
    n_gons = int(np.count_nonzero(np.bincount(low.faces) > 2))
    if n_gons:
        return Finding(POLYGONS, N_GONS, {"low": name, "count": n_gons})
    quads = int(np.count_nonzero(face_shapes.ambiguous_quads(low)))
    return Finding(POLYGONS, QUADS, {"low": name, "count": quads}) if quads else None


def mirrored_copies(low: Mesh) -> np.ndarray:
    """Which triangles (T,) bool are mirrored in UV space and lie on triangles that are not. `low` must have faces."""
    is_mirrored = uv_layout.areas(low) < 0.0
    if not is_mirrored.any() or is_mirrored.all():
        return np.zeros(len(is_mirrored), bool)
    place = uv_islands.stacks(low)[low.faces]
    has_other = np.zeros(int(place.max()) + 1, bool)
    has_other[place[~is_mirrored]] = True
    return is_mirrored & has_other[place]
