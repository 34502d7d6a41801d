# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures whether high and low meshes share their UV layout: whether their points on the same texel lie close in space."""

import math
from collections.abc import Sequence

import numpy as np

from ..core import udim
from ..core.declarations.values import Method
from ..core.udim import UvToClip
from ..mesh.local_space import LocalSpace, gap, local_space_of
from ..mesh.triangle_mesh import Mesh
from ..passes import mesh_upload, target
from ..passes.bake import gbuffer
from . import separation
from .separation import PROBE_SIZE

CLOSE = 0.05
"""Of the low mesh's radius: points of one texel that are nearer than this, along the surface, belong together."""
SHARE = 0.96
"""How many of the low mesh's texels must have such a point on the high meshes."""
SHIFT = 0.5
"""Of a part's extent: how much the vectors from low to high may differ on the texels of a small part, on average. On a bolt in
another place, or rotated, they differ by more than its size, although it may lie close to the place of its UVs."""
LEAST = 32
"""Texels a side on which each of many high meshes is compared; each of a few is compared on up to PROBE_SIZE."""
SMALLEST = 1e-6
"""In tiles: UVs of a smaller extent cover no texel of any map."""
WIDE = 2.0
"""In tiles: UVs of a larger extent are compared tile by tile."""


def choose(low: Mesh, highs: Sequence[Mesh], tiles: Sequence[int]) -> tuple[str, str, np.ndarray | None]:
    """The method for these meshes on these UDIM tiles, and why.

    Returns FLATTEN or CAST, a clause, and, for FLATTEN, the result of separation.sample on a large map. A single high mesh
    with another UV layout calls for CAST.
    """
    without = next((high for high in highs if high.uv is None), None)
    if without is not None:
        has_instances = without.instances > 1
        instances = f"is made of {without.instances:,} instances, which have no UVs of their own"
        what = instances if has_instances else "has no UV layer"
        return Method.CAST, f"{without.name!r} {what}", None
    texels = separation.sample(separation.flat_probe(low, highs), (PROBE_SIZE, PROBE_SIZE), tiles)
    on_low, both = texels[..., 3] != 0.0, texels[..., 3] > 0.0
    if not both.any():
        return Method.CAST, "the UV layouts have no texel in common", None
    # High and low objects often stand side by side in the scene: their offset as wholes does not count.
    offset, surface = separation.offset(texels, Method.FLATTEN), _Surface(low)
    away = np.stack([surface.draw(udim.uv_to_clip(tile))[1] for tile in tiles])[both][:, :3]
    # Detail rises from the low surface; another layout moves points along it.
    between = _along((texels[both][:, :3] - offset) / surface.local_space.size, away)
    share = np.count_nonzero(np.linalg.norm(between, axis=1) < CLOSE) / np.count_nonzero(on_low)
    other = differing(low, highs, tiles, offset) if len(highs) > 1 else ""
    if other:
        return Method.CAST, other, None
    if share < SHARE:
        return (
            Method.CAST,
            f"the UV layouts differ: on {share:.1%} of the texels alone the meshes' points lie close",
            None,
        )
    return Method.FLATTEN, f"the UV layouts agree: on {share:.1%} of the texels the meshes' points lie close", texels


def differing(low: Mesh, highs: Sequence[Mesh], tiles: Sequence[int], offset: np.ndarray) -> str:
    """A clause about the first high mesh whose UV layout, compared alone, is not that of `low`; empty if there is none.

    offset (3,): the measured offset between low and high meshes as wholes, in scene units. It is wrong if most texels belong to
    meshes of another layout. The meshes are therefore also compared without it, and the better result counts.
    """
    surface = _Surface(low, max(LEAST, PROBE_SIZE // math.isqrt(len(highs))))

    def found(by: np.ndarray) -> list[str]:
        clauses = (_difference(surface, high, _views(low, high, tiles), by) for high in highs)
        return list(filter(None, clauses))

    clauses = found(np.zeros(3))
    if clauses and offset.any():
        clauses = min(clauses, found(offset), key=len)
    return clauses[0] if clauses else ""


def elsewhere(low: Mesh, highs: Sequence[Mesh]) -> np.ndarray:
    """Where the meshes do not belong together on the UV tile 0 to 1: (PROBE_SIZE, PROBE_SIZE) bool, row 0 is v = 0.

    There, the high meshes' point is not CLOSE to any point of the low mesh on the same texel, along its surface.
    """
    surface, uv_to_clip = _Surface(low), udim.uv_to_clip()
    above = separation.draw_points(
        [separation.upload(high, surface.local_space) for high in highs], (PROBE_SIZE, PROBE_SIZE), uv_to_clip
    )
    layers = [surface.draw(uv_to_clip, is_last=is_last) for is_last in (True, False)]
    both = (above[..., 3] > 0.0) & (layers[0][0][..., 3] > 0.0)
    result = np.zeros(both.shape, bool)
    if both.any():
        above = above[both][:, :3]
        above -= _moved_aside(surface.local_space, low, highs, above - layers[0][0][both][:, :3])
        between = (_along(above - below[both][:, :3], away[both][:, :3]) for below, away in layers)
        result[both] = np.min([np.linalg.norm(vectors, axis=1) for vectors in between], axis=0) >= CLOSE
    return result


def _moved_aside(local_space: LocalSpace, low: Mesh, highs: Sequence[Mesh], between: np.ndarray) -> np.ndarray:
    """The offset (3,) between the meshes as wholes, in `local_space`. between (N, 3): the vectors between their points.

    It is 0 unless the boxes around the meshes differ by it as well: moved UVs do not move objects.
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
        return f"the UV layout of {high.name!r} differs: its points lie close on {close.mean():.1%} of its texels alone"
    return ""


def _close(surface: "_Surface", high: Mesh, uv_to_clip: UvToClip, offset: np.ndarray) -> np.ndarray:
    """Whether the points of `high` belong to those of the low mesh: (N,) bool for the texels that both cover."""
    above = separation.draw_points(
        [separation.upload(high, surface.local_space)], (surface.side, surface.side), uv_to_clip
    )
    above[..., :3] -= offset / surface.local_space.size
    layers = []
    for is_last in (True, False):
        below, away = surface.draw(uv_to_clip, is_last=is_last)
        both = (above[..., 3] > 0.0) & (below[..., 3] > 0.0)
        points = below[both][:, :3]
        layers.append((points, _along(above[both][:, :3] - points, away[both][:, :3])))
    if not len(points):
        return np.empty(0, bool)
    far = np.array([np.linalg.norm(between, axis=1) for _, between in layers])
    nearer, far = far.argmin(axis=0), far.min(axis=0)
    points, between = (np.where(nearer[:, None] == 0, *sides) for sides in zip(*layers, strict=True))
    shift = np.linalg.norm(between - np.median(between, axis=0), axis=1).mean()
    extent = np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    return (far < CLOSE) & (shift <= SHIFT * extent)


def _views(low: Mesh, high: Mesh, tiles: Sequence[int]) -> list[UvToClip]:
    """Each uv_to_clip of a view of the UVs that both meshes share, which may be small, or outside the baked tiles."""
    boxes = [_box(mesh.uv) for mesh in (low, high)]
    first, last = np.max([box[0] for box in boxes], axis=0), np.min([box[1] for box in boxes], axis=0)
    extent = last - first
    if not (extent > SMALLEST).all():
        return []
    if extent.max() > WIDE:
        return [udim.uv_to_clip(tile) for tile in tiles]
    scale = 2.0 / extent
    return [(*scale.tolist(), *(-1.0 - first * scale).tolist())]


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
        # Mirrored halves overlap. The reversed order shows the half that the other order hides.
        orders = {True: low.triangles, False: np.ascontiguousarray(low.triangles[::-1])}
        self.uploaded = {is_last: mesh_upload.upload(order, **attributes) for is_last, order in orders.items()}

    def draw(self, uv_to_clip: UvToClip, *, is_last: bool = True) -> list[np.ndarray]:
        """The points, in the local space, and the unit normals, (side, side, 4) each.

        Where triangles share texels, they are those of the last triangle, or of the first one.
        """
        drawn = target.get("audit rays", self.side, self.side, "RGBA32F", "RGBA32F")
        gbuffer.draw(drawn, self.uploaded[is_last], uv_to_clip)
        seen = [np.empty((self.side, self.side, 4), np.float32) for _ in range(2)]
        for slot, array in enumerate(seen):
            drawn.read(array, slot=slot)
        return seen


def _along(vectors: np.ndarray, away: np.ndarray) -> np.ndarray:
    """`vectors` (N, 3) without their parts along the unit vectors `away` (N, 3)."""
    return vectors - (vectors * away).sum(axis=1, keepdims=True) * away
