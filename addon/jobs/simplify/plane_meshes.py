# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes low meshes of hard surfaces: planes and straight edges stay, and edges are hard where those of the surface are."""

import math
from dataclasses import dataclass, replace
from functools import partial

import bpy
import numpy as np

from ...core.progress import Progress, Task, Timings, aside, relay
from ...core.simplify import Candidate, making
from ...mesh import fitting, hard_edges, planes, topology, welding
from ...mesh.closest import Surface
from ...mesh.fitting import FitOptions, Samples
from ...mesh.plane_collapse import Costs, OnPlanes, collapse_on_planes, without_needless
from ...mesh.planes import Planes
from ...mesh.topology import EdgeTable, edge_keys
from ...mesh.triangles import diagonal, face_normals
from . import low_meshes, touching_solids
from .low_meshes import LowMesh
from .touching_solids import Solids

LEAST_SHARE = 0.3
"""The share of the area in large planes from which a surface counts as hard."""
COSTS = (
    Costs(),
    Costs(closing=8.0),
    Costs(closing=0.125),
    Costs(fade=math.inf),
    Costs(closing=8.0, fade=math.inf),
)
"""What goes first: all are tried, and what a viewer sees decides."""
MOST_BAD_EDGES = 0.01
"""The share of edges with more than two triangles, or with two that point to different sides, from which a surface is taken for
a triangle soup."""
HELD = 5e-4, 0.0, None
"""The shares of the surface, tried in turn, from which planes hold their vertices; None if all vertices stay."""
TURNED = 1e-6
"""The share of a mesh's area from which a triangle counts that is turned over."""
ON_IT = 1e-4
"""The share of the diagonal up to which a sample lies on a surface."""
MOST = 200_000
"""The most triangles of a surface that is made coarser in this way: parts by CAD programs have fewer."""


@dataclass(frozen=True, eq=False)
class PlaneSource:
    """A hard surface that low meshes are made of.

    Attributes:
        whole: All of it, and the same surface with as few triangles as it takes.
        planes: Of all of its triangles.
        groups: (T,) int, their smooth groups.
        samples: As DecimationSource has them.
        timings: As DecimationSource has them.
        bias: As DecimationSource has it.
        costs: One of COSTS.
    """

    whole: tuple[OnPlanes, OnPlanes]
    planes: Planes
    groups: np.ndarray
    samples: Samples
    timings: Timings
    bias: float
    costs: Costs
    is_remeshed = False
    is_collapsed = False
    left_out = 0
    mirror = None
    keeps_planes = True

    @property
    def triangles(self) -> int:
        return len(self.whole[0].triangles)

    def make(self, triangles: int) -> Task[list[LowMesh]]:
        """A low mesh of about this many triangles."""
        yield making(triangles)
        shaping = aside(partial(self._shaped, triangles), making(triangles))
        points, corners, source, nearest = yield from relay(shaping, within=lambda: self.timings.timed("decimate"))
        of = self.planes.of[source]
        data = low_meshes.new_mesh(points, corners)
        shade(data, hard_edges.shading(points, corners, self.groups[source], of))
        return [LowMesh(data, self, nearest, is_folded(points, corners, self.planes.normals[of]))]

    def _shaped(self, triangles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """About this many triangles: points (P, 3), the triangles (N, 3), those of the surface (N,) that they were, and the
        triangle of each sample."""
        start = self.whole[triangles < len(self.whole[1].triangles)]
        its_planes = replace(self.planes, of=self.planes.of[start.of])
        coarse = collapse_on_planes(start.points, start.triangles, its_planes, triangles, self.costs)
        source = start.of[coarse.of]
        points, nearest = self._fitted(coarse, self.planes.of[source])
        return points, coarse.triangles, source, nearest

    def corrected(self, _: Candidate) -> None:
        """Nothing is spared: each of COSTS is tried from the start."""

    def _fitted(self, coarse: OnPlanes, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points (P, 3) of a coarse mesh as fitting.fit moves them, and the triangle (N,) of each sample. Where triangles
        turn over, small planes hold their vertices, too, then all stay. of: (N,) int, the planes of its triangles."""
        for least in HELD:
            count = len(coarse.points)
            free = np.zeros((count, 3, 3))
            if least is not None:
                free = self.planes.free_directions(coarse.triangles, of, count, least)
            fitted = fitting.fit(coarse.points, coarse.triangles, self.samples, FitOptions(free=free))
            if not is_folded(fitted[0], coarse.triangles, self.planes.normals[of]):
                break
        return fitted


def is_folded(points: np.ndarray, triangles: np.ndarray, normals: np.ndarray) -> bool:
    """Whether triangles (T, 3) with an area show their backs. normals: (T, 3), of their planes."""
    doubled = face_normals(points, triangles)
    least = TURNED * np.linalg.norm(doubled, axis=1).sum()
    return bool(((doubled * normals).sum(axis=1) < -least).any())


def sources_of(
    surface: tuple[np.ndarray, np.ndarray],
    samples: Samples,
    timings: Timings,
    *,
    bias: float,
    solids: Solids,
    step: Progress,
) -> Task[list[PlaneSource]]:
    """A surface as a source for each of COSTS; none if it is not hard, or too many edges are bad, also of solids that touch,
    one by one. Solids that touch are one, if that takes fewer triangles.

    Args:
        surface: points (V, 3) float32 and triangles (T, 3) int.
        samples: of the surface.
        timings, bias: as PlaneSource has them.
        solids: of the surface, with what is hidden of it.
        step: yielded while solids are united.
    """
    points, triangles = surface
    if len(triangles) > MOST:
        return []
    found = planes.planes(points, triangles)
    if found.large_share < LEAST_SHARE:
        return []
    given, united = _HardSurface.of(points, triangles, found), None
    one = yield from touching_solids.united(solids, step)
    if one is not None:
        points, triangles, on_one = _shown(*one, samples)
        united = _HardSurface.of(points, triangles, planes.planes(points, triangles)) if len(triangles) else None
    usable = [each for each in (united, given) if each is not None]
    if not usable:
        return []
    best = min(usable, key=lambda each: len(each.both[1].triangles))
    if best is united:
        samples = on_one
    return [PlaneSource(best.both, best.planes, best.groups, samples, timings, bias, costs) for costs in COSTS]


@dataclass(frozen=True, eq=False)
class _HardSurface:
    """A hard surface, with the attributes of PlaneSource."""

    both: tuple[OnPlanes, OnPlanes]
    planes: Planes
    groups: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, triangles: np.ndarray, found: Planes) -> "_HardSurface | None":
        """None if too many of its edges are bad. found: its planes."""
        points, triangles = welding.parted(points, triangles)
        if EdgeTable.of(triangles).bad_edge_share > MOST_BAD_EDGES:
            return None
        groups = hard_edges.smooth_groups(triangles, found.normals[found.of])
        whole = OnPlanes(points, triangles, np.arange(len(triangles)))
        return cls((whole, without_needless(points, triangles, found)), found, groups)


def _shown(points: np.ndarray, triangles: np.ndarray, samples: Samples) -> tuple[np.ndarray, np.ndarray, Samples]:
    """What samples lie on of a surface, without shells inside it: its points and triangles, and the samples that do, in these
    triangles: not those between solids."""
    nearest, _, squares = Surface(points, triangles).closest(samples.points.astype(np.float32))
    is_on = squares <= (ON_IT * diagonal(points)) ** 2
    labels, _ = topology.components(tuple(triangles.T), len(points))
    stays = np.isin(labels, labels[nearest[is_on]])
    used, shown = topology.numbered(triangles[stays])
    nearest = (np.cumsum(stays) - 1)[nearest]
    return points[used], shown, replace(samples, triangles=nearest).chosen(is_on)


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
