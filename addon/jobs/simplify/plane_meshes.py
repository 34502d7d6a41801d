# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes low meshes of hard surfaces: planes and straight edges stay, and edges are hard where those of the surface are."""

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.progress import Timings
from ...core.simplify import Candidate
from ...mesh import fitting, hard_edges, planes, welding
from ...mesh.fitting import FitOptions, Samples
from ...mesh.plane_collapse import collapse_on_planes
from ...mesh.planes import Planes
from ...mesh.topology import edge_keys
from . import low_meshes
from .low_meshes import LowMesh

LEAST_SHARE = 0.3
"""The share of the area in large planes from which a surface counts as hard."""
CLOSING = 1.0, 8.0, 0.125
"""The factors, tried in turn, on what it costs to close holes and the like: what a viewer sees decides."""
MOST = 400_000
"""The most triangles of a surface that is made coarser in this way: parts by CAD programs have fewer."""


@dataclass(frozen=True, eq=False)
class PlaneSource:
    """A hard surface that low meshes are made of.

    Attributes:
        points: (V, 3) float32.
        corners: (T, 3) int, its triangles.
        planes: Of the triangles.
        groups: (T,) int, their smooth groups.
        samples: As DecimationSource has them.
        timings: As DecimationSource has them.
        bias: As DecimationSource has it.
        closing: One of CLOSING.
    """

    points: np.ndarray
    corners: np.ndarray
    planes: Planes
    groups: np.ndarray
    samples: Samples
    timings: Timings
    bias: float = 1.0
    closing: float = CLOSING[0]
    is_remeshed = False
    is_collapsed = False
    left_out = 0
    mirror = None
    keeps_planes = True

    @property
    def triangles(self) -> int:
        return len(self.corners)

    def make(self, triangles: int) -> list[LowMesh]:
        """A low mesh of about this many triangles."""
        with self.timings.timed("decimate"):
            coarse = collapse_on_planes(self.points, self.corners, self.planes, triangles, self.closing)
            of = self.planes.of[coarse.of]
            free = self.planes.free_directions(coarse.triangles, of, len(coarse.points))
            points, nearest = fitting.fit(coarse.points, coarse.triangles, self.samples, FitOptions(free=free))
            data = low_meshes.new_mesh(points, coarse.triangles)
            shade(data, hard_edges.shading(points, coarse.triangles, self.groups[coarse.of], of))
        return [LowMesh(data, self, nearest)]

    def corrected(self, _: Candidate) -> "PlaneSource | None":
        """The same surface, of which more or less is closed; None if all of CLOSING was tried."""
        following = CLOSING[CLOSING.index(self.closing) + 1 :]
        return replace(self, closing=following[0]) if following else None


def source_of(data: bpy.types.Mesh, samples: Samples, timings: Timings, bias: float) -> PlaneSource | None:
    """A mesh of triangles as a source; None if it is no hard surface. samples: of it, by which the judge finds places."""
    points, triangles = low_meshes.arrays(data)
    if len(triangles) > MOST:
        return None
    found = planes.planes(points, triangles)
    if found.large_share < LEAST_SHARE:
        return None
    points, triangles = welding.parted(points, triangles)
    groups = hard_edges.smooth_groups(triangles, found.normals[found.of])
    return PlaneSource(points, triangles, found, groups, samples, timings, bias)


def shade(data: bpy.types.Mesh, shading: hard_edges.Shading) -> None:
    """Give a mesh of triangles hard edges and normals."""
    ends = np.empty((len(data.edges), 2), np.int32)
    data.edges.foreach_get("vertices", ends.reshape(-1))
    width = len(data.vertices)
    is_hard = np.isin(edge_keys(*ends.T, width), edge_keys(*shading.hard.T, width))
    data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
    data.edges.foreach_set("use_edge_sharp", is_hard)
    data.normals_split_custom_set(shading.normals.reshape(-1, 3))
    data.update()
