# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes low meshes of hard surfaces: planes and straight edges stay, and edges are hard where those of the surface are."""

from dataclasses import dataclass

import bpy
import numpy as np

from ...core.progress import Timings
from ...core.simplify import Candidate
from ...mesh import hard_edges, planes
from ...mesh.closest import Surface
from ...mesh.fitting import Samples
from ...mesh.plane_collapse import collapse_on_planes
from ...mesh.planes import Planes
from ...mesh.topology import edge_keys
from . import low_meshes
from .low_meshes import LowMesh

LEAST_SHARE = 0.3
"""The share of the area in large planes from which a surface counts as hard."""
MOST = 400_000
"""The most triangles of a surface that is made coarser in this way: parts by CAD programs have fewer."""


@dataclass(frozen=True, eq=False)
class PlaneSource:
    """A hard surface that low meshes are made of.

    Attributes:
        data: Of triangles.
        planes: Of the triangles.
        groups: (T,) int, their smooth groups.
        samples: As DecimationSource has them.
        timings: As DecimationSource has them.
        bias: As DecimationSource has it.
    """

    data: bpy.types.Mesh
    planes: Planes
    groups: np.ndarray
    samples: Samples
    timings: Timings
    bias: float = 1.0
    is_remeshed = False
    is_collapsed = False
    left_out = 0
    keeps_planes = True

    @property
    def triangles(self) -> int:
        return len(self.data.polygons)

    def make(self, triangles: int) -> list[LowMesh]:
        """A low mesh of about this many triangles."""
        with self.timings.timed("decimate"):
            coarse = collapse_on_planes(*low_meshes.arrays(self.data), self.planes, triangles)
            data = low_meshes.new_mesh(coarse.points, coarse.triangles)
            shade(
                data,
                hard_edges.shading(coarse.points, coarse.triangles, self.groups[coarse.of], self.planes.of[coarse.of]),
            )
            surface = Surface(coarse.points.astype(np.float32), coarse.triangles)
            nearest, _, _ = surface.closest(self.samples.points.astype(np.float32))
        return [LowMesh(data, self, nearest)]

    def corrected(self, _: Candidate) -> "PlaneSource | None":
        """None: what a viewer sees decides nothing here."""
        return None


def source_of(data: bpy.types.Mesh, samples: Samples, timings: Timings, bias: float) -> PlaneSource | None:
    """A mesh of triangles as a source; None if it is no hard surface. samples: of it, by which the judge finds places."""
    points, triangles = low_meshes.arrays(data)
    if len(triangles) > MOST:
        return None
    found = planes.planes(points, triangles)
    if found.large_share < LEAST_SHARE:
        return None
    groups = hard_edges.smooth_groups(triangles, found.normals[found.of])
    return PlaneSource(data, found, groups, samples, timings, bias)


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
