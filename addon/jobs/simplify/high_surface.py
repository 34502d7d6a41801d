# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the high objects of a game asset as one surface, and finds what low meshes can be decimated from.

Most surfaces are decimated themselves. Triangle soups, whose triangles share edges with none or with many, and surfaces with
much inside are remeshed by voxels, too.
"""

import math
from dataclasses import dataclass
from functools import cached_property, partial

import bpy
import numpy as np
from mathutils import Matrix

from ...core.asset_limits import USUAL_MENDING, Mending
from ...core.declarations.choices import Symmetry
from ...core.errors import BakeError
from ...core.progress import Progress, Task, Timings, aside
from ...core.settings import Settings
from ...core.simplify import Candidate
from ...engine import hidden_faces, high_look
from ...mesh import flush, mirrors, orientation, seen_parts, small_parts, topology
from ...mesh.closest import Surface
from ...mesh.closing import Closing
from ...mesh.edges import is_without_area
from ...mesh.fitting import Samples, surface_samples
from ...mesh.mirrors import Plane
from ...mesh.small_parts import NOTHING_SMALL, Small
from ...mesh.topology import EdgeTable
from ...mesh.triangles import diagonal, enclosed_volumes, face_areas, transformed
from ...mesh.welding import thinned, weld
from ...scene import evaluation, mesh_reader
from ...scene.high_reader import Reader
from ..job import Job
from . import plane_meshes
from .low_meshes import REMESH_BIAS, DecimationSource, Source, arrays, new_mesh, remeshed, sources_of
from .plane_meshes import MOST_BAD_EDGES
from .touching_solids import Solids

MOST_HIDDEN = 0.05
"""The share of the area that sees nothing of the outside, from which a surface is remeshed, too."""
FLAT = 0.01
"""The volume that a patch encloses, for an area of 1, below which it is a sheet. A sphere has 0.094."""
FAR_AWAY = 1e9
"""Scene units. Nothing is measured beyond them: squares of single precision end at 1e19."""
MOST_READ = 2_000_000
"""The triangles from which a surface is thinned by a grid first: Blender's Decimate takes 600 bytes for each.
Tried: 5,000 triangles of 648,448 that were thinned to 500,000 have 4 % more error."""
PLANES_BIAS = 1.0 / 1.1
"""The bias of low meshes that keep planes and edges: they may look that much worse, since renderers and tools show normals far
from their faces in ways that no judge here sees."""
NEAR_CORNERS = np.array([(1, 1, 1), (8, 1, 1), (1, 8, 1), (1, 1, 8)]) / ((3,), (10,), (10,), (10,))
"""Barycentric coordinates (4, 3): a large triangle is left out only if none of these points on it sees the outside."""
NEAR_EDGES = np.array([(8, 8, 1), (1, 8, 8), (8, 1, 8)]) / 17
"""As NEAR_CORNERS, of triangles beside some that are seen: what hides their corners may end between these."""
SAMPLES = 120_000
"""The samples of the surface that are looked at from outside."""
PERCENTILE = 99
"""Of the samples by which the distance of a low mesh is measured."""
COMPARED_SAMPLES = 20_000
"""How many samples that are, on each side."""


@dataclass(frozen=True)
class HighSurface:
    """The surface that low meshes are made of.

    Attributes:
        points: (V, 3) float32, relative to `origin`.
        triangles: (T, 3) int.
        origin: (3,), in world space.
        sources: What low meshes are made of, and in which ways.
        samples: Of the surface, those that see the outside.
        hidden_share: Of the area, which does not.
        bad_edge_share: Of the edges, as EdgeTable.bad_edge_share.
        edge: The side of a triangle of middle size, in scene units.
        count: The triangles of the high objects, before any are thinned.
        crumbs: Its small parts, of which some were left out.
        holes: The small holes, of which some were filled.
        closing: What fills these; None if none were filled.
        mirror: In which it is its own mirror image, so that low meshes may be, too; None for none, or where all sources are
            halves.
        loses_planes: Whether low meshes could keep its planes, but for the symmetry that was asked for.
    """

    points: np.ndarray
    triangles: np.ndarray
    origin: np.ndarray
    sources: list[Source]
    samples: Samples
    hidden_share: float
    bad_edge_share: float
    edge: float
    count: int
    crumbs: Small = NOTHING_SMALL
    holes: Small = NOTHING_SMALL
    closing: Closing | None = None
    mirror: Plane | None = None
    loses_planes: bool = False

    @property
    def is_hard(self) -> bool:
        """Whether it has planes and edges that low meshes may keep, as machine parts have."""
        return any(source.keeps_planes for source in self.sources)

    def distance(self, low: bpy.types.Object) -> float:
        """The distance between this surface and a low object that 99 % of the samples on each of them have at most.

        Returns a share of the longest side of the box.
        """
        to_world = mesh_reader.matrix(low)
        mesh = mesh_reader.surface(low.data, "", low.name, to_world)
        points = transformed(mesh.positions, to_world) - self.origin
        triangles = mesh.vertices[mesh.triangles]
        of_low = surface_samples(points, triangles, COMPARED_SAMPLES).points.astype(np.float32)
        own = self.samples.spread(COMPARED_SAMPLES).points.astype(np.float32)
        pairs = (Surface(points.astype(np.float32), triangles), own), (self._surface, of_low)
        far = max(math.sqrt(float(np.percentile(surface.closest(points)[2], PERCENTILE))) for surface, points in pairs)
        return far / float(np.ptp(self.points, axis=0).max())

    def new_object(self, context: bpy.types.Context, name: str, data: bpy.types.Mesh) -> bpy.types.Object:
        """An object of the scene with a mesh that is relative to `origin`."""
        obj = bpy.data.objects.new(name, data)
        context.scene.collection.objects.link(obj)
        obj.matrix_world = Matrix.Translation(self.origin)
        context.view_layer.update()
        return obj

    def symmetric(self, candidate: Candidate) -> Source | None:
        """The source of a low mesh, as one of low meshes that equal their mirror images; None if this surface does not."""
        is_whole = self.mirror is not None and isinstance(candidate.maker, DecimationSource)
        return candidate.maker.halved(self.mirror) if is_whole else None

    @cached_property
    def _surface(self) -> Surface:
        return Surface(self.points, self.triangles)


def read(
    context: bpy.types.Context,
    job: Job,
    settings: Settings,
    timings: Timings,
    mending: Mending = USUAL_MENDING,
    *,
    enough: int = 0,
) -> Task[HighSurface]:
    """Read the high objects of a job with their modifiers and instances. Raises BakeError.

    Args:
        timings: get the time of low meshes, as their sources say.
        enough: the triangles that low meshes may have. A surface of so few is not cut to be its own mirror image, unless along
            an axis that is asked for: it has all its triangles anyway.
    """
    yield _reading(0.0)
    points, triangles = _triangles(context, job, settings)
    yield _reading(0.1)
    name, origin = job.highs[0].name, np.array(job.highs[0].matrix_world.translation, np.float64)
    count, edge = len(triangles), _edge(face_areas(points, triangles))
    within = flush.rounding(points)
    points = (points - origin).astype(np.float32)
    mended = yield from aside(partial(_mended, points, triangles, mending, name), _reading(0.2))
    solids = Solids.of((mended.points, mended.triangles), (points, triangles), within)
    points, triangles, samples = mended.points, mended.triangles, mended.samples
    yield _reading(0.4)
    data = new_mesh(points, triangles)
    yield _reading(0.5)
    is_seen = _seen(data, points, triangles, samples)
    yield _reading(0.6)
    hidden, outer = 1.0 - float(is_seen[samples.triangles].mean()), samples.chosen(is_seen[samples.triangles])
    is_asked_for, mirror = len(mending.symmetry.axes) == 1, None
    if is_asked_for or len(triangles) > enough:
        mirroring = partial(_mirror, points, triangles, outer, mending.symmetry, name)
        mirror = yield from aside(mirroring, _reading(0.7))
    stays = yield from aside(partial(seen_parts.kept, points, triangles, is_seen), _reading(0.75))
    sources = yield from _sources(data, solids, stays, (samples, outer), timings, hidden=hidden, bad=mended.bad)
    loses_planes = mirror is not None and is_asked_for and any(each.keeps_planes for each in sources)
    if mirror is not None and is_asked_for:
        sources = [each.halved(mirror) for each in sources if isinstance(each, DecimationSource)]
        mirror = None
    return HighSurface(
        points,
        triangles,
        origin,
        sources,
        outer,
        hidden,
        mended.bad,
        edge,
        count,
        mended.crumbs,
        mended.holes,
        mended.closing and mended.closing.moved(origin),
        mirror,
        loses_planes,
    )


def look(context: bpy.types.Context, job: Job, settings: Settings, mending: Mending = USUAL_MENDING) -> list[str]:
    """What the high objects of a job are, and what an asset will change of them, in lines. Raises BakeError."""
    context.view_layer.update()  # a script may have moved them
    points, triangles = _triangles(context, job, settings)
    count, name = len(triangles), job.highs[0].name
    points = (points - np.array(job.highs[0].matrix_world.translation)).astype(np.float32)
    mended = _mended(points, triangles, mending, name)
    joined, welded = weld(*_read_at_most(points, triangles))
    labels, parts = topology.components(tuple(welded.T), len(joined))
    alone = EdgeTable.of(welded).alone
    closed = parts - len(np.unique(labels[alone // 3]))
    lines = [high_look.counts(count, parts, closed)]
    turned = mended.turned / max(1, len(welded))
    lines.append(f"{turned:.1%} of the faces will be turned over" if mended.turned else "No face will be turned over")
    if len(alone):
        lines.append(
            f"Open edges: {len(alone):,}. {mended.holes.mended:,} small holes will be filled, {mended.holes.stay:,} stay. "
            "What stays open is open in the low mesh, too, and does no harm"
        )
    if mended.crumbs.mended or mended.crumbs.stay:
        lines.append(f"{mended.crumbs.mended:,} small parts will be left out, {mended.crumbs.stay:,} stay")
    return lines


def _reading(done: float) -> Progress:
    return Progress("Reading the high objects", done)


@dataclass(frozen=True)
class _Mended:
    """A surface that was welded, thinned and mended. The attributes are those of HighSurface; `samples` are of all of it, and
    `bad` is its bad_edge_share."""

    points: np.ndarray
    triangles: np.ndarray
    samples: Samples
    bad: float
    crumbs: Small
    holes: Small
    closing: Closing | None
    turned: int = 0
    """The triangles that were turned over."""


def _mended(points: np.ndarray, triangles: np.ndarray, mending: Mending, name: str) -> _Mended:
    """Points (V, 3) float32 and triangles (T, 3) int as one surface. Raises BakeError."""
    points, triangles = weld(*_read_at_most(points, triangles))
    if not len(triangles):
        raise BakeError(f"{name!r} has no faces with an area: choose a mesh that has some.")
    farthest = float(np.abs(points).max())
    if farthest > FAR_AWAY:
        raise BakeError(f"{name!r} has a vertex {farthest:.3g} units away: remove what is far from the rest.")
    is_crumb, crumbs = small_parts.is_crumb(points, triangles, mending.crumbs)
    triangles = triangles[~is_crumb]
    turned = 0
    if EdgeTable.of(triangles).is_against.any():
        as_read, triangles = triangles, _to_one_side(points, triangles)
        turned = int(np.count_nonzero((as_read != triangles).any(axis=1)))
    before = len(triangles)
    points, triangles, holes = small_parts.filled(points, triangles, mending.holes)
    closing = Closing.of(points, triangles, before) if len(triangles) > before else None
    points, triangles = weld(points, triangles)
    samples = surface_samples(points, triangles, SAMPLES)
    if not len(samples.points):
        raise BakeError(f"{name!r} is too small for its normals: scale the mesh itself up.")
    return _Mended(points, triangles, samples, EdgeTable.of(triangles).bad_edge_share, crumbs, holes, closing, turned)


def _sources(
    data: bpy.types.Mesh,
    solids: Solids,
    stays: np.ndarray,
    samples: tuple[Samples, Samples],
    timings: Timings,
    *,
    hidden: float,
    bad: float,
) -> Task[list[Source]]:
    """What low meshes are made of.

    Args:
        data, solids: the whole surface.
        stays: (T,) bool, which triangles are not left out.
        samples: of all of it, and of what sees the outside.
        timings: as DecimationSource has them.
        hidden, bad: as HighSurface has these shares.
    """
    points, triangles = arrays(data)
    everywhere, outer = samples
    result, outside = [], data
    if hidden > MOST_HIDDEN:
        outside = new_mesh(points, triangles[stays])
    yield _reading(0.8)
    if bad > MOST_BAD_EDGES or hidden > MOST_HIDDEN:
        voxels = remeshed(data, float(face_areas(points, triangles).sum()) * (1.0 - hidden), outer)
        if voxels is not None:
            result += sources_of(voxels, outer, timings, is_remeshed=True)
        yield _reading(0.9)
    # The faces of single triangles can point to any side, so that only the remeshed one has an outside.
    if not result or EdgeTable.of(triangles[stays]).bad_edge_share <= MOST_BAD_EDGES:
        on_it = everywhere.chosen(stays[everywhere.triangles])
        result += sources_of(outside, on_it, timings, bias=REMESH_BIAS if result else 1.0)
    plain, _ = result[-2:]
    bias, step = PLANES_BIAS * plain.bias, _reading(1.0)
    yield step
    hard = plane_meshes.sources_of(arrays(outside), plain.samples, timings, bias=bias, solids=solids, step=step)
    return result + (yield from hard)


def _mirror(points: np.ndarray, triangles: np.ndarray, outer: Samples, symmetry: Symmetry, name: str) -> Plane | None:
    """In which plane a surface is its own mirror image, among those that are asked for. Raises BakeError."""
    axes = symmetry.axes
    plane = mirrors.plane_of(points, triangles, outer, axes) if axes else None
    if plane is None and len(axes) == 1:
        raise BakeError(
            f"{name!r} is not its own mirror image along {symmetry} of the world: turn it, choose another axis, or none."
        )
    return plane


def _read_at_most(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A mesh of at most about MOST_READ triangles, not yet welded."""
    if len(triangles) <= MOST_READ:
        return points, triangles
    used, triangles = topology.numbered(topology.whole_once(topology.places(points)[triangles]))
    points = points[used]
    if len(triangles) <= MOST_READ:  # the others were there twice
        return points, triangles
    points, triangles = thinned(points, triangles, MOST_READ)
    return points.astype(np.float32), triangles


def edge_of(context: bpy.types.Context, job: Job, settings: Settings) -> float:
    """The side of a triangle of middle size of the high objects, in scene units."""
    return _edge(face_areas(*_triangles(context, job, settings)))


def _seen(data: bpy.types.Mesh, points: np.ndarray, triangles: np.ndarray, samples: Samples) -> np.ndarray:
    """Which triangles (T,) bool see something of the outside, from some of the samples on them, their middle, near a corner, or
    near an edge.

    If nearly all of the area does, all count as seen.
    """
    mesh = mesh_reader.surface(data, "", data.name, np.eye(4))
    some = samples.spread(COMPARED_SAMPLES)
    is_open = hidden_faces.sees_outside(mesh, some.points, some.triangles, Timings())
    of_each = np.bincount(some.triangles, minlength=len(triangles))
    is_seen = np.bincount(some.triangles, is_open, len(triangles)) > hidden_faces.PEEPING * of_each
    if is_seen[some.triangles].mean() > 1.0 - MOST_HIDDEN:
        return np.ones(len(triangles), bool)

    def look(asked: np.ndarray, weights: np.ndarray) -> None:
        left = np.flatnonzero(asked & ~is_seen)
        on_them = np.einsum("c,tcx->tx", weights, points[triangles[left]].astype(np.float64))
        is_seen[left] = hidden_faces.sees_outside(mesh, on_them, left, Timings())

    for weights in NEAR_CORNERS:
        look(~is_seen, weights)
    neighbors = EdgeTable.of(triangles).neighbors
    for weights in NEAR_EDGES:
        if 1.0 - is_seen[samples.triangles].mean() > MOST_HIDDEN:  # else nothing is left out
            look((is_seen[neighbors] & (neighbors >= 0)).any(axis=1), weights)
    return is_seen if is_seen[samples.triangles].any() else np.ones(len(triangles), bool)


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


def _to_one_side(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles (T, 3) int, turned so that those of a patch point to one side: outwards if it encloses a volume, or to the
    side to which most of its area points."""
    patches = orientation.patches(points, triangles, diagonal(points))
    turned = np.where(patches.is_against[:, None], triangles[:, ::-1], triangles)
    of_each, middles = face_areas(points, triangles), points[triangles].mean(axis=1, dtype=np.float64)
    area = np.bincount(patches.labels, of_each, patches.count)
    weights = of_each / np.maximum(area, 1e-300)[patches.labels]
    centers = topology.sums_of(patches.labels, weights[:, None] * middles, patches.count)
    corners = points[turned] - centers[patches.labels][:, None]
    volumes = np.bincount(patches.labels, enclosed_volumes(corners) / 6.0, patches.count)
    points_inwards = volumes < -FLAT * area**1.5
    return np.where(points_inwards[patches.labels, None], turned[:, ::-1], turned)


def _edge(areas: np.ndarray) -> float:
    """The side of an equilateral triangle of middle size."""
    return math.sqrt(4.0 / math.sqrt(3.0) * float(np.median(areas)))
