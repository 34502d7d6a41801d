# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures whether high and low meshes share their UV layout: whether their points on the same texel are close in space."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core import udim
from ..core.declarations.choices import Method
from ..core.udim import UvToClip
from ..mesh import uv_layout
from ..mesh.local_space import LocalSpace, gap, local_space_of
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import face_areas
from ..passes import low_in_uv, mesh_upload, target
from . import separation
from .separation import PROBE_SIZE

CLOSE = 0.05
"""Share of the low mesh's radius. Points on the same texel belong together if they are closer than this, along the surface."""
SHARE = 0.96
"""Share of the low mesh's texels that must have such a point on the high meshes."""
EVERYWHERE = 0.995
"""Share of the low mesh's texels that have such a point where the layouts agree everywhere: half of those without one that the
checks warn of."""
CROSSED = 1e-3
"""Share of the texels with the high normals of one part of the low mesh and the tangents of another, without harm."""
SHIFT = 0.5
"""Share of a small part's extent: how much the vectors from low to high may differ on its texels, on average. If a bolt has
the UVs of another bolt close to it, or is rotated, they differ by more than its size."""
UNDRAWN = 1e-4
"""Share of the surface of a high mesh that may have no area in UV space: decimation leaves such slivers. More is detail."""
SMALLEST_PROBE = 32
"""Texels a side on which each of many high meshes is compared. Each of a few is compared on up to PROBE_SIZE."""
SMALLEST_EXTENT = 1e-6
"""In tiles. UVs of a smaller extent cover no texel of any map."""
LARGEST_EXTENT = 2.0
"""In tiles. UVs of a larger extent are compared tile by tile."""


@dataclass(frozen=True)
class Agreement:
    """Whether high and low meshes share their UV layout, and a clause that says why.

    Attributes:
        separation: The result of separation.sample on a large map, if they do.
        is_everywhere: Whether they share it on so many texels that nothing is missing or out of place.
        is_shared: Whether they do.
    """

    is_shared: bool
    why: str
    separation: np.ndarray | None = None
    is_everywhere: bool = False


def measure(low: Mesh, highs: Sequence[Mesh], tiles: Sequence[int]) -> Agreement:
    """Compare the UV layouts on these UDIM tiles. They are not shared if a single high mesh has another one."""
    no_uv = next((high for high in highs if high.uv is None), None)
    if no_uv is not None:
        instances = f"is made of {no_uv.instances:,} instances, which have no UVs of their own"
        reason = instances if no_uv.instances > 1 else "has no UV layer"
        return Agreement(False, f"{no_uv.name!r} {reason}")
    texels = separation.sample(separation.flat_probe(low, highs), (PROBE_SIZE, PROBE_SIZE), tiles)
    on_low, both = texels[..., 3] != 0.0, texels[..., 3] > 0.0
    if not both.any():
        return Agreement(False, "the UV layouts have no texel in common")
    # High and low objects are often side by side in the scene: the offset between them does not count.
    offset, surface = separation.offset(texels, Method.FLATTEN), _Surface(low)
    normals = np.stack([surface.draw(udim.uv_to_clip(tile))[1] for tile in tiles])[both][:, :3]
    # Detail moves points away from the low surface; another layout moves them along it.
    between = _tangential((texels[both][:, :3] - offset) / surface.local_space.size, normals)
    share = np.count_nonzero(np.linalg.norm(between, axis=1) < CLOSE) / np.count_nonzero(on_low)
    difference = differing(low, highs, tiles, offset) if len(highs) > 1 else ""
    if difference:
        return Agreement(False, difference)
    if share < SHARE:
        return Agreement(
            False, f"the UV layouts differ: the meshes' points are close on only {share:.1%} of the texels"
        )
    without_area = next(filter(None, map(_undrawn, highs)), "")
    if without_area:
        return Agreement(False, without_area)
    is_everywhere = bool(share >= EVERYWHERE)
    if is_everywhere and share < 1.0 - CROSSED:
        is_everywhere = crossed(low, [separation.thinned(high) for high in highs], tiles) <= CROSSED
    agree = "agree" if is_everywhere else "agree on most texels"
    return Agreement(
        True,
        f"the UV layouts {agree}: the meshes' points are close on {share:.1%} of the texels",
        texels,
        is_everywhere,
    )


def differing(low: Mesh, highs: Sequence[Mesh], tiles: Sequence[int], offset: np.ndarray) -> str:
    """A clause about the first high mesh whose own UV layout differs from that of `low`; empty if there is none.

    offset (3,): the measured offset of the high meshes from the low one, in scene units. It is wrong if most texels belong to
    meshes with another layout. The meshes are therefore also compared without it, and the better result counts.
    """
    surface = _Surface(low, max(SMALLEST_PROBE, PROBE_SIZE // math.isqrt(len(highs))))

    def differences(by: np.ndarray) -> list[str]:
        clauses = (_difference(surface, high, _views(low, high, tiles), by) for high in highs)
        return list(filter(None, clauses))

    clauses = differences(np.zeros(3))
    if clauses and offset.any():
        clauses = min(clauses, differences(offset), key=len)
    return clauses[0] if clauses else ""


def mismatched(low: Mesh, highs: Sequence[Mesh], tile: int = udim.FIRST) -> np.ndarray:
    """Where the meshes do not belong together on a UDIM tile: (PROBE_SIZE, PROBE_SIZE) bool, row 0 is at its lowest v.

    On these texels, the high meshes' point is not CLOSE to any point of the low mesh, along its surface.
    """
    both, between = _along(_Surface(low), low, highs, udim.uv_to_clip(tile))
    result = np.zeros(both.shape, bool)
    result[both] = between.min(axis=0) >= CLOSE
    return result


def crossed(low: Mesh, highs: Sequence[Mesh], tiles: Sequence[int]) -> float:
    """The share of the texels that both cover where parts of `low` share UVs and the high meshes are drawn in another order:
    their last point is close, along the surface, to the first point of the low mesh and not to the last one."""
    surface = _Surface(low)
    last, first = np.concatenate([_along(surface, low, highs, udim.uv_to_clip(tile))[1] for tile in tiles], axis=1)
    return np.count_nonzero((last >= CLOSE) & (first < CLOSE)) / max(1, len(last))


def _along(
    surface: "_Surface", low: Mesh, highs: Sequence[Mesh], uv_to_clip: UvToClip
) -> tuple[np.ndarray, np.ndarray]:
    """The texels (side, side) bool that both meshes cover. On these, the distances (2, N) along the surface from the high
    meshes' point to the last and the first point of `low`, in its local space."""
    above = separation.PointMeshes(highs, surface.local_space).draw((surface.side, surface.side), uv_to_clip)
    layers = [surface.draw(uv_to_clip, is_last=is_last) for is_last in (True, False)]
    both = (above[..., 3] > 0.0) & (layers[0][0][..., 3] > 0.0)
    if not both.any():
        return both, np.empty((2, 0), np.float32)
    above = above[both][:, :3]
    above -= _object_offset(surface.local_space, low, highs, above - layers[0][0][both][:, :3])
    between = (_tangential(above - below[both][:, :3], normals[both][:, :3]) for below, normals in layers)
    return both, np.stack([np.linalg.norm(vectors, axis=1) for vectors in between])


def _object_offset(local_space: LocalSpace, low: Mesh, highs: Sequence[Mesh], between: np.ndarray) -> np.ndarray:
    """The offset (3,) between the objects, in `local_space`. between (N, 3): the vectors between points on the same texels.

    It is 0 unless the boxes around the meshes have the same offset: moved UVs do not move objects.
    """
    offset = np.median(between, axis=0)
    between_boxes = local_space_of(highs).origin - local_space_of([low]).origin
    is_aside = gap(low, highs) > 0.0 or np.linalg.norm(offset - between_boxes / local_space.size) < CLOSE
    return offset if is_aside else np.zeros(3, np.float32)


def _difference(surface: "_Surface", high: Mesh, views: Sequence[UvToClip], offset: np.ndarray) -> str:
    close = [_close(surface, high, uv_to_clip, offset) for uv_to_clip in views]
    close = np.concatenate(close) if close else np.empty(0, bool)
    if not close.size:
        return f"{high.name!r} has no texel in common with the low mesh"
    if close.mean() < SHARE:
        return f"the UV layout of {high.name!r} differs: its points are close on only {close.mean():.1%} of its texels"
    return ""


def _close(surface: "_Surface", high: Mesh, uv_to_clip: UvToClip, offset: np.ndarray) -> np.ndarray:
    """Whether the points of `high` and of the low mesh belong together: (N,) bool for the texels that both cover."""
    above = separation.PointMeshes([high], surface.local_space).draw((surface.side, surface.side), uv_to_clip)
    above[..., :3] -= offset / surface.local_space.size
    layers = []
    for is_last in (True, False):
        below, normals = surface.draw(uv_to_clip, is_last=is_last)
        both = (above[..., 3] > 0.0) & (below[..., 3] > 0.0)
        points = below[both][:, :3]
        layers.append((points, _tangential(above[both][:, :3] - points, normals[both][:, :3])))
    if not len(points):
        return np.empty(0, bool)
    far = np.array([np.linalg.norm(between, axis=1) for _, between in layers])
    nearer, far = far.argmin(axis=0), far.min(axis=0)
    points, between = (np.where(nearer[:, None] == 0, *sides) for sides in zip(*layers, strict=True))
    shift = np.linalg.norm(between - np.median(between, axis=0), axis=1).mean()
    extent = np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    return (far < CLOSE) & (shift <= SHIFT * extent)


def _views(low: Mesh, high: Mesh, tiles: Sequence[int]) -> list[UvToClip]:
    """The uv_to_clip of each view of the UVs that both meshes cover, which may be small, or outside the baked tiles."""
    boxes = [_box(mesh.uv) for mesh in (low, high)]
    first, last = np.max([box[0] for box in boxes], axis=0), np.min([box[1] for box in boxes], axis=0)
    extent = last - first
    if not (extent > SMALLEST_EXTENT).all():
        return []
    if extent.max() > LARGEST_EXTENT:
        return [udim.uv_to_clip(tile) for tile in tiles]
    scale = 2.0 / extent
    shift = -1.0 - first * scale
    return [(float(scale[0]), float(scale[1]), float(shift[0]), float(shift[1]))]


def _box(uv: np.ndarray) -> np.ndarray:
    """The lowest and highest finite `uv` (C, 2): (2, 2) float64. If none is finite, the lowest is above the highest."""
    uv = uv[np.isfinite(uv).all(axis=1)]
    return np.array([uv.min(axis=0, initial=np.inf), uv.max(axis=0, initial=-np.inf)], np.float64)


class _Surface:
    """The low mesh, drawn in UV space on `side` texels along u and v."""

    def __init__(self, low: Mesh, side: int = PROBE_SIZE):
        self.local_space, self.side = local_space_of([low]), side
        attributes = {
            "uv": low.uv,
            "position": np.take(self.local_space.points(low), low.vertices, axis=0),
            "direction": low.to_world_normals(low.normals),
        }
        # Mirrored halves overlap. In reverse order, the hidden half is drawn last and shows.
        orders = {True: low.triangles, False: np.ascontiguousarray(low.triangles[::-1])}
        self.uploaded = {is_last: mesh_upload.upload(order, **attributes) for is_last, order in orders.items()}

    def draw(self, uv_to_clip: UvToClip, *, is_last: bool = True) -> list[np.ndarray]:
        """The points, in local space, and the unit normals, (side, side, 4) each.

        Where triangles share texels, the last triangle counts, or the first one if not `is_last`.
        """
        drawn = target.get("audit rays", self.side, self.side, "RGBA32F", "RGBA32F")
        low_in_uv.draw_points(drawn, self.uploaded[is_last], uv_to_clip)
        return [drawn.texels(slot) for slot in range(2)]


def _undrawn(high: Mesh) -> str:
    """Why Flatten would not draw a part of a high mesh, as a clause; empty if it draws all of it."""
    is_flat = uv_layout.areas(high) == 0.0
    if not is_flat.any():
        return ""
    with np.errstate(over="ignore", invalid="ignore"):  # of faces that are very large
        sizes = face_areas(high.positions, high.vertices[high.triangles])
        share = sizes[is_flat].sum(dtype=np.float64) / (sizes.sum(dtype=np.float64) or 1.0)
    return f"{share:.1%} of the surface of {high.name!r} has no area in UV space" if share > UNDRAWN else ""


def _tangential(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """`vectors` (N, 3) without their components along the unit `normals` (N, 3)."""
    return vectors - (vectors * normals).sum(axis=1, keepdims=True) * normals
