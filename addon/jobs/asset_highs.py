# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the high objects of a game asset as one surface, and finds what low meshes can be decimated from.

Most surfaces are decimated themselves. Soups of triangles and surfaces with much inside are remeshed by voxels, too.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import bpy
import numpy as np
from mathutils import Matrix

from ..core.asset import OFF
from ..core.errors import BakeError
from ..core.progress import Timings
from ..core.settings import Settings
from ..engine import outer_skin
from ..mesh import face_weights, fitting, folds, orientation, topology
from ..mesh.closest import Surface
from ..mesh.collapse import CollapseOptions, PartialCollapse, collapse, partial_collapse
from ..mesh.edges import is_without_area
from ..mesh.fitting import Samples, surface_samples
from ..mesh.topology import EdgeTable
from ..mesh.triangles import enclosed_volumes, face_areas, transformed
from ..mesh.welding import ClusterOptions, cluster, weld
from ..scene import evaluation, mesh_reader, mesh_writer
from ..scene.high_reader import Reader
from . import temporary
from .job import Job
from .temporary import TEMPORARY, TemporaryMeshes

MOST_FAULTS = 0.01
"""The share of edges with more than two triangles, or with two that point to different sides, from which a surface is taken for
a soup of triangles."""
MOST_INSIDE = 0.05
"""The share of the area that sees nothing of the outside, from which a surface is remeshed, too."""
VOXELS = 60_000
"""About how many voxels the outer surface has that is remeshed."""
FLAT = 0.01
"""The volume that a patch encloses, for an area of 1, below which it is a sheet. A sphere has 0.094."""
MOST_ALONG = 2000
"""The most voxels along the longest side of the box: along needles, by their area alone, there would be millions."""
FAR_AWAY = 1e9
"""Scene units. Nothing is measured beyond them: squares of single precision end at 1e19."""
FAR, MOST_FAR = 2.0, 0.25
"""Voxels, and a share of what is seen from outside. If more of it is farther from the remeshed surface, the volume is open.
What is farther in a closed volume lies in gaps that the voxels close."""
MOST_READ = 2_000_000
"""The triangles from which a surface is thinned by a grid first: Blender's Decimate takes 600 bytes for each."""
NEAR_CORNERS = np.array([(1, 1, 1), (8, 1, 1), (1, 8, 1), (1, 1, 8)]) / ((3,), (10,), (10,), (10,))
"""Barycentric coordinates (4, 3): a large triangle is left out only if none of these places on it sees the outside."""
LEAST_LEFT = 0.5
"""The share of the area below which thinning has lost single triangles, which no edges connect with others."""
DENSE = 60_000
"""The triangles that Decimate leaves of larger surfaces, for all low meshes that are coarser still: it takes most time."""
FINER = 6
"""How many times as many triangles as a low mesh those have at least: until then, hardly anything is lost."""
MOST_BEGUN = 0.8
"""The share of the triangles up to which low meshes that differ by their weights alone have a mesh in common on their way."""
FITTED = 10_000, 60_000
"""The fewest and the most places on the surface to which low meshes are fitted: two a triangle of the surface, or about 20 a
triangle of the low mesh."""
AROUND = 120_000
"""The places on the surface that are looked at from outside."""
PERCENTILE = 99
"""Of the places by which the distance of a low mesh is measured."""
PLACES = 20_000
"""How many places that are, on each side."""


@dataclass(frozen=True, eq=False)
class Base:
    """A mesh that low ones are made of, and the way.

    data: of triangles. dense: of as many of them as the way needs for most low meshes. places: on the surface, in the triangles
    of `dense`. is_remeshed: whether it is made of voxels. weights: of the triangles of `dense`, if edges collapse to the best
    places by them, as mesh/collapse.py does; without them, Decimate makes it all. begun: where these collapses go on, so far.
    """

    data: bpy.types.Mesh
    dense: bpy.types.Mesh
    places: Samples
    is_remeshed: bool = False
    weights: np.ndarray | None = None
    begun: list[PartialCollapse] = field(default_factory=list)

    @property
    def triangles(self) -> int:
        return len(self.data.polygons)

    @property
    def is_collapsed(self) -> bool:
        return self.weights is not None

    def weighted(self) -> "Base":
        """The same mesh, whose edges collapse by how much it bends."""
        return replace(self, weights=face_weights.by_bending(*_arrays(self.dense)), begun=[])

    def corrected(self, nearest: np.ndarray, errors: np.ndarray) -> "Base":
        """The same mesh, whose edges collapse by what a viewer saw of a low one.

        Args:
            nearest: (N,) int, the triangle of the low mesh at each place.
            errors: (N,), what viewers saw at each place.
        """
        sums = np.bincount(nearest, errors * self.places.shares)
        excess = sums / max(float(sums.mean()), 1e-300)
        _, triangles = _arrays(self.dense)
        weights = face_weights.by_error(self.weights, triangles, self.places.triangles, excess[nearest])
        return replace(self, weights=weights)

    def low(self, triangles: int) -> bpy.types.Mesh:
        """A mesh of about this many triangles. The caller removes it."""
        is_enough = FINER * triangles <= len(self.dense.polygons) or self.dense == self.data
        if not self.is_collapsed or not is_enough:
            return decimated(self.dense if is_enough else self.data, triangles)
        options = CollapseOptions(triangles, self.weights, self._begun(triangles))
        coarse = _mesh(*collapse(*_arrays(self.dense), options))
        if len(coarse.polygons) <= triangles:
            return coarse
        try:  # its borders are in the way
            return decimated(coarse, triangles)
        finally:
            bpy.data.meshes.remove(coarse)

    def _begun(self, triangles: int) -> PartialCollapse | None:
        """Where edges go on to collapse to this many triangles; None for the dense mesh."""
        least = FINER * triangles
        if least >= MOST_BEGUN * len(self.dense.polygons):
            return None
        found = [each for each in self.begun if len(each.triangles) >= least]
        if not found:
            found = [partial_collapse(*_arrays(self.dense), CollapseOptions(least, self.weights))]
            self.begun.extend(found)
        return min(found, key=lambda each: len(each.triangles))

    def fitted(self, low: bpy.types.Mesh) -> np.ndarray:
        """Move the vertices of a low mesh to where this surface is nearest. Returns its triangle at each place, (N,) int."""
        points, nearest = fitting.fit(*_arrays(low), self.places)
        low.vertices.foreach_set("co", points.astype(np.float32).reshape(-1))
        return nearest


@dataclass(frozen=True)
class High:
    """The surface that low meshes are made of.

    points (V, 3) float32, relative to `origin`; triangles (T, 3) int. bases: what low meshes are made of, and in which ways.
    around: places on the surface that see the outside. inside: the share of the area that does not. faults: as
    EdgeTable.bad_edge_share has it. edge: the side of a triangle of middle size. count: the triangles of the high objects,
    before any are thinned.
    """

    points: np.ndarray
    triangles: np.ndarray
    origin: np.ndarray
    bases: list[Base]
    around: Samples
    inside: float
    faults: float
    edge: float
    count: int

    def distance(self, points: np.ndarray, triangles: np.ndarray) -> float:
        """The distance between this surface and a low mesh that 99 % of the places on each of them have at most, as a share of
        the longest side of the box.

        Args:
            points: (P, 3) float, relative to `origin`.
            triangles: (N, 3) int.
        """
        own = self.around.points[:: max(1, len(self.around.points) // PLACES)]
        of_low = surface_samples(points, triangles, PLACES).points
        squares = [Surface(points.astype(np.float32), triangles).closest(own.astype(np.float32))[2]]
        squares.append(self._surface.closest(of_low.astype(np.float32))[2])
        longest = float(np.ptp(self.points, axis=0).max())
        return max(math.sqrt(float(np.percentile(each, PERCENTILE))) for each in squares) / longest

    def low(self, base: Base, triangles: int) -> bpy.types.Mesh:
        """A mesh of about this many triangles, without folds. The caller removes it."""
        data, folded = self._unfolded(base.low(triangles))
        if not folded or len(data.polygons) > (1.0 - OFF / 2.0) * triangles:
            return data
        bpy.data.meshes.remove(data)
        return self._unfolded(base.low(triangles + folded))[0]

    def _unfolded(self, data: bpy.types.Mesh) -> tuple[bpy.types.Mesh, int]:
        """A mesh without the folds of `data`, which is `data` itself or takes its place, and the triangles that it lost."""
        corners = mesh_reader.corner_vertices(data).reshape(-1, 3)
        points, unfolded = folds.unfold(mesh_reader.points(data), corners, self.around)
        if unfolded is corners:
            return data, 0
        bpy.data.meshes.remove(data)
        return _mesh(points, unfolded), len(corners) - len(unfolded)

    @cached_property
    def _surface(self) -> Surface:
        return Surface(self.points, self.triangles)


def read(context: bpy.types.Context, job: Job, settings: Settings, meshes: TemporaryMeshes) -> High:
    """Read the high objects of a job with their modifiers and instances. Raises BakeError. meshes: owns those of the bases."""
    points, triangles = _triangles(context, job, settings)
    origin, count = np.array(job.highs[0].matrix_world.translation, np.float64), len(triangles)
    edge = _edge(face_areas(points, triangles))
    points, triangles = weld((points - origin).astype(np.float32), triangles)
    if len(triangles) > MOST_READ:
        area = float(face_areas(points, triangles).sum())
        cell = max(
            math.sqrt(2.0 * area / MOST_READ), float(np.ptp(points, axis=0).max()) / 2**20
        )  # two triangles a cell
        thinned = cluster(points, triangles, ClusterOptions(cell))
        if face_areas(*thinned).sum() < LEAST_LEFT * area:
            thinned = cluster(points, triangles, ClusterOptions(cell, is_torn=True))
        points, triangles = weld(thinned[0].astype(np.float32), thinned[1])
    if not len(triangles):
        raise BakeError(f"{job.highs[0].name!r} has no faces with an area: choose a mesh that has some.")
    farthest = float(np.abs(points).max())
    if farthest > FAR_AWAY:
        raise BakeError(
            f"{job.highs[0].name!r} has a vertex {farthest:.3g} units away: remove what is far from the rest."
        )
    edges = EdgeTable.of(triangles)
    if edges.is_against.any():
        triangles = _to_one_side(points, triangles)
        edges = EdgeTable.of(triangles)
    faults = edges.bad_edge_share
    data = meshes.own(_mesh(points, triangles))
    around = surface_samples(points, triangles, AROUND)
    if not len(around.points):
        raise BakeError(f"{job.highs[0].name!r} is too small for its normals: scale the mesh itself up.")
    is_seen = _seen(data, points, triangles, around)
    inside = 1.0 - float(is_seen[around.triangles].mean())
    outer = around.chosen(is_seen[around.triangles])
    of_each, outside = face_areas(points, triangles), data
    if inside > MOST_INSIDE:
        outside = meshes.own(_mesh(points, triangles[is_seen]))
    bases = []
    if faults > MOST_FAULTS or inside > MOST_INSIDE:
        remeshed = _remeshed(data, float(of_each.sum()) * (1.0 - inside), outer, meshes)
        if remeshed is not None:
            bases.append(_base(remeshed, meshes, outer, is_remeshed=True))
    # The faces of a soup can point to any side, so that only the remeshed one has an outside.
    if not bases or EdgeTable.of(triangles[is_seen]).bad_edge_share <= MOST_FAULTS:
        bases.append(_base(outside, meshes, outer))
    bases = [way for each in bases for way in (each, each.weighted())]
    return High(points, triangles, origin, bases, outer, inside, faults, edge, count)


def edge_of(context: bpy.types.Context, job: Job, settings: Settings) -> float:
    """The side of a triangle of middle size of the high objects, in scene units."""
    return _edge(face_areas(*_triangles(context, job, settings)))


def decimated(data: bpy.types.Mesh, triangles: int) -> bpy.types.Mesh:
    """A mesh of about this many triangles, by Blender's Decimate. data: of triangles. The caller removes it."""
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, data.copy())
        decimate = obj.modifiers.new(TEMPORARY, "DECIMATE")
        decimate.ratio = min(1.0, triangles / len(data.polygons))
        decimate.use_collapse_triangulate = True
        return temporary.evaluated(scene, obj)


def _base(data: bpy.types.Mesh, meshes: TemporaryMeshes, around: Samples, *, is_remeshed: bool = False) -> Base:
    """The base of a mesh without weights. around: places on the surface that low meshes are fitted to."""
    if len(data.polygons) <= DENSE and not is_remeshed:
        points, triangles = _arrays(data)
        weights = face_weights.by_bending(points, triangles) ** 2
        count = int(np.clip(2 * len(triangles), *FITTED))
        return Base(data, data, surface_samples(points, triangles, count, weights))
    dense = data if len(data.polygons) <= DENSE else meshes.own(decimated(data, DENSE))
    places = around.chosen(slice(None, None, max(1, len(around.points) // FITTED[1])))
    nearest, _, _ = Surface(*_arrays(dense)).closest(places.points.astype(np.float32))
    return Base(data, dense, replace(places, triangles=nearest), is_remeshed)


def _arrays(data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The points (V, 3) float32 and the triangles (T, 3) int of a mesh of triangles."""
    return mesh_reader.points(data), mesh_reader.corner_vertices(data).reshape(-1, 3)


def _seen(data: bpy.types.Mesh, points: np.ndarray, triangles: np.ndarray, around: Samples) -> np.ndarray:
    """Which triangles (T,) bool see something of the outside, from some of the places on them, their middle, or near a corner.

    If nearly all of the area does, all count as seen.
    """
    mesh = mesh_reader.surface(data, "", data.name, np.eye(4))
    some = around.chosen(slice(None, None, max(1, len(around.points) // PLACES)))
    is_open = outer_skin.sees_outside(mesh, some.points, some.triangles, Timings())
    of_each = np.bincount(some.triangles, minlength=len(triangles))
    is_seen = np.bincount(some.triangles, is_open, len(triangles)) > outer_skin.PEEPING * of_each
    if is_seen[some.triangles].mean() > 1.0 - MOST_INSIDE:
        return np.ones(len(triangles), bool)
    for weights in NEAR_CORNERS:
        left = np.flatnonzero(~is_seen)
        places = np.einsum("c,tcx->tx", weights, points[triangles[left]].astype(np.float64))
        is_seen[left] = outer_skin.sees_outside(mesh, places, left, Timings())
    return is_seen if is_seen[around.triangles].any() else np.ones(len(triangles), bool)


def _triangles(context: bpy.types.Context, job: Job, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """All triangles of the high objects with their modifiers and instances: points (V, 3) float64 in world space, and (T, 3)
    int. Raises BakeError."""
    highs = job.highs
    plain = settings.of_shapes()
    numbered = dict(enumerate(highs, start=1))
    read = evaluation.evaluate(
        context,
        highs,
        lambda depsgraph: Reader(depsgraph, highs[0], "", plain).read(numbered),
        modifiers=settings.map.modifiers,
    )
    if all(map(is_without_area, read)):
        raise BakeError(f"{highs[0].name!r} has no faces with an area: choose a mesh that has some.")
    points, triangles, first = [], [], 0
    for mesh in read:
        points.append(transformed(mesh.positions, mesh.to_world))
        triangles.append(mesh.vertices[mesh.front_triangles] + first)
        first += len(mesh.positions)
    return np.concatenate(points), np.concatenate(triangles)


def _mesh(points: np.ndarray, triangles: np.ndarray) -> bpy.types.Mesh:
    data = bpy.data.meshes.new(TEMPORARY)
    mesh_writer.fill(data, points, triangles)
    data.update(calc_edges=True)
    return data


def _to_one_side(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles (T, 3) int, turned so that those of a patch point to one side: outwards if it encloses a volume, or to the
    side to which most of its area points."""
    patches = orientation.patches(points, triangles, float(np.linalg.norm(np.ptp(points, axis=0))))
    turned = np.where(patches.is_against[:, None], triangles[:, ::-1], triangles)
    of_each, middles = face_areas(points, triangles), points[triangles].mean(axis=1, dtype=np.float64)
    area = np.bincount(patches.labels, of_each, patches.count)
    weights = of_each / np.maximum(area, 1e-300)[patches.labels]
    centers = topology.sums_of(patches.labels, weights[:, None] * middles, patches.count)
    corners = points[turned] - centers[patches.labels][:, None]
    volumes = np.bincount(patches.labels, enclosed_volumes(corners) / 6.0, patches.count)
    points_inwards = volumes < -FLAT * area**1.5
    return np.where(points_inwards[patches.labels, None], turned[:, ::-1], turned)


def _remeshed(data: bpy.types.Mesh, area: float, around: Samples, meshes: TemporaryMeshes) -> bpy.types.Mesh | None:
    """The surface of the volume that the triangles enclose, of voxels; None if they enclose none.

    area: of what is seen from outside, in the places `around`.
    """
    longest = float(np.ptp(mesh_reader.points(data), axis=0).max())
    voxel = max(math.sqrt(area / VOXELS), longest / MOST_ALONG)
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, data.copy())
        obj.data.transform(Matrix.Scale(1.0 / voxel, 4))  # Blender takes no voxels smaller than 0.0001
        remesh = obj.modifiers.new(TEMPORARY, "REMESH")
        remesh.mode, remesh.voxel_size = "VOXEL", 1.0
        obj.modifiers.new(TEMPORARY, "TRIANGULATE")
        result = meshes.own(temporary.evaluated(scene, obj))
    if not result.polygons:
        return None
    result.transform(Matrix.Scale(voxel, 4))
    corners = mesh_reader.corner_vertices(result).reshape(-1, 3)
    places = around.points[:: max(1, len(around.points) // PLACES)].astype(np.float32)
    _, _, squares = Surface(mesh_reader.points(result), corners).closest(places)
    return result if np.mean(squares > (FAR * voxel) ** 2) < MOST_FAR else None


def _edge(areas: np.ndarray) -> float:
    """The side of an equilateral triangle of middle size."""
    return math.sqrt(4.0 / math.sqrt(3.0) * float(np.median(areas)))
