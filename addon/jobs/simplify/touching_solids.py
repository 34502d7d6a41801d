# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes one solid of solids that touch, as boxes of planks do: without the faces between them, which nobody sees.

A low mesh with these faces spends triangles on them, and shows them where a corner of another solid went.
"""

from dataclasses import dataclass

import bpy
import numpy as np

from ...core.progress import Progress, Task
from ...mesh import topology, welding
from ...mesh.flush import Flush
from ...mesh.topology import EdgeTable
from ...mesh.triangles import enclosed_volumes, face_areas
from ...mesh.welding import WeldOptions
from ...scene import mesh_reader
from .. import temporary
from ..temporary import TEMPORARY
from .low_meshes import new_mesh

MOST, MOST_IN_ALL = 10_000, 200_000
"""The most triangles that are united, and the most in all steps: each takes the next solid. Blender's exact Boolean takes up to
a second for 10,000."""
ROUNDING = 1e-5
"""The share of their volume by which the volume of one solid may differ from that of all, and of their area that goes at least:
what is between them."""
KEEPING_BACKS = WeldOptions(keeps_backs=True)


@dataclass(frozen=True, eq=False)
class Solids:
    """A surface that may be several solids.

    Attributes:
        points: (V, 3) float32.
        triangles: (T, 3) int; where solids touch, those of all of them.
        within: what is so far apart touches, as flush.rounding finds it.
    """

    points: np.ndarray
    triangles: np.ndarray
    within: float

    @classmethod
    def of(cls, mesh: tuple[np.ndarray, np.ndarray], source: tuple[np.ndarray, np.ndarray], within: float) -> "Solids":
        """A welded mesh with the triangles that it has lost, of two in one place, of those of its source."""
        points, triangles = mesh
        return cls(points, welding.with_backs(mesh, source) if len(source[1]) <= MOST else triangles, within)


def united(solids: Solids, step: Progress) -> Task[tuple[np.ndarray, np.ndarray] | None]:
    """The surface of one solid, for several that touch and share no volume; None for any others.

    step: yielded for each solid.

    Returns:
        Points (P, 3) float32 and triangles (N, 3) int.
    """
    if len(solids.triangles) > MOST:
        return None
    flush = Flush.of(solids.points, solids.triangles, solids.within)
    points, triangles = welding.weld(flush.points.astype(np.float32), flush.triangles, KEEPING_BACKS)
    is_crowded = EdgeTable.of(triangles).is_crowded.any()
    points, triangles = welding.parted(points, triangles)
    labels, count = topology.components(tuple(triangles.T), len(points))
    if count == 1 or count * len(triangles) > MOST_IN_ALL or not _is_closed(triangles):
        return None
    volumes = np.bincount(labels, enclosed_volumes(points.astype(np.float64), triangles))
    areas = np.bincount(labels, face_areas(points, triangles, np.float64))
    has_sheets = (np.abs(volumes) <= solids.within * areas).any()
    if has_sheets or not (is_crowded or _touch(points[triangles], labels)):
        return None
    with temporary.scene() as scene:
        whole, wanted = temporary.add_object(scene, bpy.data.meshes.new(TEMPORARY)), 0.0
        for label in np.argsort(-volumes, kind="stable").tolist():
            yield step
            used, corners = np.unique(triangles[labels == label], return_inverse=True)
            _add(scene, whole, new_mesh(points[used], corners.reshape(-1, 3)))
            read = mesh_reader.surface(whole.data, "", TEMPORARY, np.eye(4))
            volume = enclosed_volumes(read.positions.astype(np.float64), read.vertices[read.triangles]).sum()
            wanted += volumes[label]
            if abs(volume - wanted) > ROUNDING * volumes.sum():
                return None
        points, triangles = welding.weld(read.positions, read.vertices[read.triangles])
    triangles = _without_gaps(triangles)
    is_less = face_areas(points, triangles, np.float64).sum() < (1.0 - ROUNDING) * areas.sum()
    return (flush.placed(points).astype(np.float32), triangles) if is_less and _is_closed(triangles) else None


def _touch(corners: np.ndarray, labels: np.ndarray) -> bool:
    """Whether there are solids whose boxes touch: they share a part of a side, and no volume.

    corners: (T, 3, 3). labels: (T,) int, the solids.
    """
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order], prepend=-1))
    low = np.minimum.reduceat(corners.min(axis=1)[order], starts)
    high = np.maximum.reduceat(corners.max(axis=1)[order], starts)
    shared = np.sort(np.minimum(high[:, None], high) - np.maximum(low[:, None], low), axis=2)
    return bool(((shared[..., 0] == 0.0) & (shared[..., 1] > 0.0)).any())


def _without_gaps(triangles: np.ndarray) -> np.ndarray:
    """Triangles with a fan in each gap between them: the Boolean loses those that are lines."""
    table = EdgeTable.of(triangles)
    first, last = table.first[table.alone], table.last[table.alone]
    hubs = topology.connected(table.width, first, last)[first]
    fans = np.stack([hubs, last, first], axis=1)
    return np.concatenate([triangles, fans[topology.has_corners(fans)]])


def _is_closed(triangles: np.ndarray) -> bool:
    table = EdgeTable.of(triangles)
    return not table.is_open.any() and not table.is_against.any()


def _add(scene: bpy.types.Scene, whole: bpy.types.Object, part: bpy.types.Mesh) -> None:
    """Unite the mesh of an object of a scene with another mesh, which goes."""
    before, other = whole.data, temporary.add_object(scene, part)
    boolean = whole.modifiers.new(TEMPORARY, "BOOLEAN")
    boolean.operation, boolean.solver, boolean.object = "UNION", "EXACT", other
    whole.data = temporary.evaluated(scene, whole)
    whole.modifiers.clear()
    for data in (before, part):
        bpy.data.meshes.remove(data)  # and the object with it
