# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds problems of meshes before they are baked: faces that point to the wrong side, and what other engines show wrong."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core import threads, udim
from ..core.declarations import bases, targets
from ..core.declarations.choices import Space, Storage, Wrap
from ..core.sentences import LOOK, NOTE, WRONG, Sentence
from ..core.settings import MapSettings, SamplingSettings, Settings
from ..engine.orienting import INWARD
from ..mesh import face_shapes, uv_islands, uv_layout, uv_seams
from ..mesh.local_space import gap_of_boxes
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import face_normals, transformed
from . import severity, uv_checks

LOW_FACES, HIGH_FACES = 256, 2048
"""The most faces of the low mesh, and of all high ones, that are compared."""
COMPARED_FACES = 64
"""The low faces that are compared at once: larger products of matrices start threads of their own, which take longer."""
AGAINST, MAYBE = 0.8, 0.2
"""The share of the low faces that point against the high ones near them, above which one of the two meshes is probably flipped,
or may be: the nearest face can be the other side of a thin part, or of one that is sunk into the surface. Rays decide."""
LEAST_FACES = 64
"""Fewer low faces say nothing."""


@dataclass(frozen=True)
class Faces:
    """Some faces of an object in world space: centers and normals (N, 3) float64; the normals have the lengths of areas."""

    centers: np.ndarray
    normals: np.ndarray

    @property
    def outward(self) -> float:
        """From -1 for a closed surface whose faces point inward to 1 for one whose faces point outward."""
        away = self.centers - self.centers.mean(axis=0)
        parts = (away * self.normals).sum(axis=1)
        most = (np.linalg.norm(away, axis=1) * np.linalg.norm(self.normals, axis=1)).sum()
        return float(parts.sum() / most) if most > 0.0 else 0.0


def faces_of_mesh(mesh: Mesh, most: int, turned: np.ndarray | None = None, *, least: int = 0) -> Faces:
    """Some triangles of a mesh, evenly spaced in their order, at most `most`. turned (T,) bool: those that were turned over;
    they count as they were before. least: triangles of a mesh with fewer are divided, so that there are about as many."""
    step = max(1, -(-len(mesh.triangles) // most))
    kept = mesh.front_triangles[::step]
    corners = transformed(mesh.positions[mesh.vertices[kept]], mesh.to_world)
    normals = face_normals(corners)
    if turned is not None:
        normals = np.where(turned[::step, None], -normals, normals)
    weights = _middles(int(np.ceil((least / max(1, len(kept))) ** 0.5)))
    centers = np.einsum("wk,tkx->twx", weights, corners).reshape(-1, 3)
    return Faces(centers, normals.repeat(len(weights), axis=0) / len(weights))


def _middles(parts: int) -> np.ndarray:
    """The weights (N, 3) of the middles of the triangles into which so many parts of each side divide a triangle."""
    parts = max(1, parts)
    u, v = np.divmod(np.arange(parts * parts), parts)
    turned = u + v >= parts  # the triangles between those that stand like the whole one
    u, v = np.where(turned, parts - 1 - u, u), np.where(turned, parts - 1 - v, v)
    u, v = ((each + np.where(turned, 2.0, 1.0) / 3.0) / parts for each in (u, v))
    return np.stack([1.0 - u - v, u, v], axis=1)


def joined_faces(faces: Sequence[Faces]) -> Faces:
    """The faces of several objects."""
    return Faces(np.concatenate([each.centers for each in faces]), np.concatenate([each.normals for each in faces]))


def share_against(low: Faces, high: Faces) -> float:
    """The share of the faces of a surface that point against the nearest ones of another in the same place, or beside it."""
    low, high = _with_area(low), _with_area(high)
    if not len(low.centers) or not len(high.centers):
        return 0.0
    # Relative to a place near them: squares of large coordinates lose the distances.
    below, above = low.centers - low.centers.mean(axis=0), high.centers - low.centers.mean(axis=0)
    above = above - offset_beside(low, high)
    squares, nearest = (above * above).sum(axis=1), np.empty(len(below), np.intp)

    def find(part: slice) -> None:
        nearest[part] = (squares - 2.0 * below[part] @ above.T).argmin(axis=1)

    threads.for_blocks(len(below), find, COMPARED_FACES)
    return float(((low.normals * high.normals[nearest]).sum(axis=1) < 0.0).mean())


def offset_beside(low: Faces, high: Faces) -> np.ndarray:
    """The way (3,) from one surface to another that lies beside it; 0 if it does not."""
    boxes = _box(low.centers), _box(high.centers)
    of_low, of_high = ((least + most) / 2.0 for least, most in boxes)
    return of_high - of_low if gap_of_boxes(*boxes) > 0.0 else np.zeros(3)


def flipped_one(low: Faces, high: Faces) -> str:
    """Which of two surfaces that point to opposite sides is flipped: "high" if only its faces point inward, else "low"."""
    return "high" if high.outward < INWARD < low.outward else "low"


GAIN = 0.5
"""By how much more of the low surface rays have to hit the outside of the high one after a flip: a surface with two sides, and
parts that stick out of both, are hit from either."""


def gains(before: float, after: float) -> bool:
    """Whether a flip is worth it. before, after: the shares of the low surface from which rays hit the outside of the high one,
    as the meshes are, and with one of them flipped."""
    return after - before > GAIN


def _with_area(faces: Faces) -> Faces:
    kept = (np.isfinite(faces.centers) & np.isfinite(faces.normals)).all(axis=1) & faces.normals.any(axis=1)
    return Faces(faces.centers[kept], faces.normals[kept])


def _box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points.min(axis=0), points.max(axis=0)


FLIPPED, POLYGONS, LAYER, HARD_EDGES, MIRRORED = "FLIPPED", "POLYGONS", "LAYER", "HARD_EDGES", "MIRRORED"
OUTSIDE, OVERLAP = "OUTSIDE", "OVERLAP"
KINDS = (FLIPPED, POLYGONS, LAYER, HARD_EDGES, MIRRORED)
"""The kinds that jobs/fixes.py can fix."""
CHECKS = {FLIPPED: severity.FLIPPED, HARD_EDGES: "hard_edges", OUTSIDE: "outside", OVERLAP: "overlap"}
"""What a finished bake calls them."""
MOST_TILES = 16
"""UDIM tiles whose overlaps are counted before a bake."""

FACING = Sentence(
    "The faces of {flipped} point to the other side than those of {other}: flip its normals before the bake.",
    WRONG,
    share=1.0,
)
N_GONS = Sentence(
    "{low} has {count:,} n-gons: exporters write no tangents for them, and other programs divide them into other triangles "
    "than this bake. Triangulate it before the bake.",
    LOOK,
)
QUADS = Sentence(
    "{low} has {count:,} quads that look different if another program divides them along the other diagonal. Triangulate it "
    "before the bake.",
    LOOK,
)
OTHER_LAYER = Sentence(
    "The map is for the UV map {layer} of {low}, but {active} is the active one: exporters write the tangents of the active "
    "one.",
    WRONG,
)
STACKED = Sentence(
    "{low} has {count:,} triangles that are mirrored onto others in UV space: the map shows the detail of one of the two. "
    "Moved by a whole tile, they read the detail of the others.",
    NOTE,
)
SENTENCES = (FACING, N_GONS, QUADS, OTHER_LAYER, severity.HARD_EDGES, STACKED, severity.OUTSIDE, severity.OVERLAP)
"""All templates of Finding."""

_BLENDERS = {bases.of_engine("CYCLES"), bases.of_engine("BLENDER_EEVEE")}


@dataclass(frozen=True)
class Finding:
    """A kind of problem, with a sentence about it.

    Attributes:
        template: One of SENTENCES, which says how much harm it does.
        values: To fill in; the share of the map, where it is known.
        kind: One of KINDS, OUTSIDE or OVERLAP.
        fits_udim: Whether UDIM tiles hold what is outside.
    """

    kind: str
    template: Sentence
    values: dict[str, Any]
    fits_udim: bool = False

    @property
    def harms(self) -> bool:
        """Whether the map is wrong, or may be."""
        return self.template.harm is not NOTE

    @property
    def sentence(self) -> Sentence:
        sentence = self.template.filled(**self.values)
        return sentence.but(sentence, kind=CHECKS.get(self.kind, ""))


def suspicion(low_faces: int) -> float:
    """The share of the faces of a low object, of so many, from which rays are asked where there is time for it."""
    return MAYBE if low_faces >= LEAST_FACES else -1.0


def find_flipped(
    low: Faces, highs: Faces, low_name: str, high_names: str, *, against: float = AGAINST
) -> list[Finding]:
    """A finding if more than a share `against` of the faces of the low object point against those of the high ones: one that
    `gains` has to confirm. The names are for the sentence."""
    if share_against(low, highs) <= against:
        return []
    is_high = flipped_one(low, highs) == "high"
    flipped, other = (high_names, low_name) if is_high else (low_name, high_names)
    return [Finding(FLIPPED, FACING, {"flipped": flipped, "other": other, "is_high": is_high})]


def is_for_others(settings: Settings) -> bool:
    """Whether a program other than Blender reads the normal map, in tangent space. settings: AUTO is not yet replaced.

    MikkTSpace can be meant for EEVEE, too: it counts if it was chosen for a map that goes into a file.
    """
    if not is_in_tangent_space(settings.map):
        return False
    if settings.map.green == "-Y" or set(settings.map.targets) - targets.IN_BLENDER:
        return True
    if settings.map.basis == bases.AUTO:
        return False
    basis = bases.of_name(settings.map.basis)
    return basis not in _BLENDERS or (basis == bases.MIKKTSPACE and settings.storing.storage == Storage.FILE)


def is_in_tangent_space(map_settings: MapSettings) -> bool:
    """Whether a bake makes a tangent-space normal map."""
    return map_settings.normal and map_settings.space == Space.TANGENT


def find(low: Mesh, uv_layer: str, active_layer: str, sampling: SamplingSettings) -> list[Finding]:
    """Look at a low mesh, which must have UVs and faces. uv_layer: of the map. active_layer: of the object."""
    name = repr(low.name)
    findings = [_polygons(low, name)]
    if active_layer and uv_layer != active_layer:
        values = {"low": name, "layer": repr(uv_layer), "active": repr(active_layer)}
        findings.append(Finding(LAYER, OTHER_LAYER, values))
    hard = len(uv_seams.hard_edges(low))
    if hard:
        findings.append(Finding(HARD_EDGES, severity.HARD_EDGES, {"low": name, "count": hard}))
    if not sampling.udim:
        stacked = int(np.count_nonzero(mirrored_copies(low)))
        if stacked:
            findings.append(Finding(MIRRORED, STACKED, {"low": name, "count": stacked}))
    return [finding for finding in findings if finding is not None]


def find_in_layout(low: Mesh, settings: Settings) -> list[Finding]:
    """What the map of a low mesh, which must have UVs and faces, will lack wherever it is used: parts that are cut off, and
    parts that share texels. As far as it can be told quickly."""
    sampling, name, found = settings.sampling, repr(low.name), []
    check = uv_checks.outside(low, sampling)
    if severity.rate("outside", check, settings) == severity.WRONG:
        where = severity.TILES if sampling.udim else severity.TILE
        values = {"low": name, "count": check["count"], "where": where, "share": check["cut_off"]}
        fits_udim = check["fits_udim"] and sampling.wrap == Wrap.NONE
        found.append(Finding(OUTSIDE, severity.OUTSIDE, values, fits_udim))
    check = uv_checks.rough_overlap(low, tiles_of(low, sampling))
    if severity.rate("overlap", check, settings) == severity.WRONG:
        found.append(Finding(OVERLAP, severity.OVERLAP, {"low": name, "share": check["share"]}))
    return found


def tiles_of(low: Mesh, sampling: SamplingSettings) -> Sequence[int]:
    """The UDIM tiles of a low mesh that are looked at."""
    return (sampling.tiles or uv_layout.tiles(low))[:MOST_TILES] if sampling.udim else (udim.FIRST,)


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
