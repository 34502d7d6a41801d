# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes a game asset of high objects: a low mesh with a UV map, as coarse as its limit allows, and its maps.

Each low mesh that the search tries is baked and looked at from all sides, so that the limit is on what a viewer sees.
"""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from ..audit.appearance import Appearance
from ..core import asset, levels, naming
from ..core.asset import Wanted
from ..core.declarations.choices import Method
from ..core.errors import BakeError, NoGpu
from ..core.naming import Suffixes
from ..core.progress import Pace, Progress, Task, part
from ..core.report import Report
from ..core.settings import Run, Settings
from ..mesh import fitting, soup, uv_stretch
from ..mesh.closest import Surface
from ..mesh.fitting import Samples
from ..output.atomic_file import all_or_none
from ..scene import evaluation, mesh_reader
from ..scene.high_reader import Reader
from . import bake_jobs, temporary, unwrapping
from .bake import draw_raw
from .job import Job, check_job
from .temporary import TEMPORARY

SEARCHED = 0.8
"""The share of the work that is done before the maps are baked."""
MOST_FAULTS = 0.01
"""The share of edges with more than two triangles, or with two that point to different sides, from which a high mesh is taken
for a soup of triangles."""
VOXELS = 60_000
"""About how many voxels the surface of a soup has."""
FAR = 2.0
"""Voxels. If the remeshed surface is farther from the high one at the 95th percentile, its volume is open."""
SIDE = 1024
"""The most texels a side of the maps by which low meshes are compared."""
SHARE, FEWEST = 0.1, 500
"""The share of the high triangles with which a search begins, and how many it begins with at least."""
OFF = 0.02
"""The share by which a number of triangles may be missed without a warning."""


@dataclass(frozen=True)
class High:
    """The surface that low meshes are made of.

    points (V, 3) float32, relative to `origin`; triangles (T, 3) int. base: the mesh that is decimated. is_remeshed: whether
    that is made of voxels. around: places on the surface. edge: the side of a triangle of middle size.
    """

    points: np.ndarray
    triangles: np.ndarray
    origin: np.ndarray
    base: bpy.types.Mesh
    is_remeshed: bool
    around: Samples
    edge: float


@dataclass(frozen=True)
class Tried:
    """A low object that was measured. excess, spent: as levels.Measured has them."""

    low: bpy.types.Object
    triangles: int
    seen: Appearance
    limit: float
    spent: float = 0.0

    @property
    def excess(self) -> float:
        return self.seen.percentile_99 / self.limit


def work(
    context: bpy.types.Context, job: Job, wanted: Wanted, settings: Settings, pace: Pace, *, suffixes: Suffixes
) -> Task[Report]:
    """Make the low object of a job, if it has none, give it a UV map, if it has none, and bake all maps of the settings.

    If the generator is closed early, or raises BakeError, nothing has changed.

    Args:
        job: of the high objects; its low object is one of them if there is none yet.
        wanted: how coarse the low mesh may be.
        suffixes: of the names of objects.
    """
    start = time.perf_counter()
    wanted.check()
    settings.check()
    if settings.sampling.udim or settings.map.texture_sets:
        raise BakeError("An asset has one texture: turn UDIM Tiles and Texture Sets off.")
    with temporary.only_if_finished(), all_or_none(), temporary.TemporaryMeshes() as meshes:
        is_made = job.low in job.highs
        found: dict[str, object] = {"is_made": is_made}
        notes: list[str] = []
        if is_made:
            yield Progress("Reading the high objects", 0.0)
            maker = _Maker(context, job, settings, pace, meshes)
            low, notes = yield from part(maker.low(wanted, suffixes), 0.05, SEARCHED)
            found |= {"is_remeshed": maker.high.is_remeshed, "of": len(maker.high.triangles), "measured": maker.count}
        else:
            low = job.low
            if low.type != "MESH":
                raise BakeError(f"{low.name!r} is no mesh: choose a mesh as the low object.")
        with _uv_map_of(low):
            is_bare = not low.data.uv_layers
            unwrapped = unwrapping.unwrap(low, settings) if is_bare else ""
            own = job.for_low(low)
            own.is_seen = True
            if wanted.fits_size:
                own.size = _size(low, maker.high.edge if is_made else _edge_of(context, job, settings))
            own_settings = replace(settings, connect_maps=True)
            if is_made:  # its UVs are new
                own_settings = replace(own_settings, method=Method.CAST)
            baking = bake_jobs.work(context, [own], own_settings, pace)
            (report,) = yield from part(baking, SEARCHED, 1.0)
    seconds = report.seconds | {"total": time.perf_counter() - start}
    found |= {"unwrapped": unwrapped, "seconds": seconds["total"] - report.seconds["total"]}
    if wanted.degrees < math.inf:
        found["degrees"] = wanted.degrees
    return replace(report, asset=found, seconds=seconds).with_warnings([*notes, *_missed(report, wanted)])


def known_low(
    context: bpy.types.Context, highs: Sequence[bpy.types.Object], suffixes: Suffixes
) -> bpy.types.Object | None:
    """The low object that belongs to the first of these by its name; None without one."""
    context.view_layer.update()  # a script may have made objects
    found = context.view_layer.objects.get(naming.low_name_of(highs[0].name, suffixes))
    return found if found is not None and found.type == "MESH" and found not in highs else None


def _missed(report: Report, wanted: Wanted) -> list[str]:
    """A sentence if the finished asset is not within the limit in degrees."""
    most = report.appearance.get("percentile_99", 0.0)
    if most <= wanted.degrees:
        return []
    return [
        f"The shading error of {report.low!r} is {most:.2f} degrees on 99 % of the pixels, and not {wanted.degrees:g}: allow "
        "more degrees or more triangles, or set a larger map."
    ]


class _Maker:
    """Makes low objects of the high ones of a job. count: how many were measured."""

    def __init__(
        self,
        context: bpy.types.Context,
        job: Job,
        settings: Settings,
        pace: Pace,
        meshes: temporary.TemporaryMeshes,
    ):
        self._context, self._job, self._pace, self._meshes = context, job, pace, meshes
        self._settings, self.count = settings, 0
        self.high = _read(context, job, settings, meshes)

    def low(self, wanted: Wanted, suffixes: Suffixes) -> Task[tuple[bpy.types.Object, list[str]]]:
        """The low object without its final UV map, and sentences about it. Raises BakeError."""
        most, notes = len(self.high.base.polygons), []
        if wanted.degrees == math.inf:
            yield Progress(f"Decimating to {wanted.triangles:,} triangles", 0.5)
            low = self._made(min(wanted.triangles, most))
        else:
            most = min(most, wanted.triangles) if wanted.triangles else most
            low = yield from self._searched(wanted.degrees, most)
        count = len(low.data.polygons)
        if wanted.degrees == math.inf and abs(count - wanted.triangles) > OFF * wanted.triangles:
            notes.append(
                f"The low mesh has {count:,} triangles, not {wanted.triangles:,}: the high mesh allows no others."
            )
        first = self._job.high_refs[0].resolve()
        low.name = low.data.name = naming.low_name_of(first.name, suffixes)
        low.hide_set(False)
        home, root = next(iter(first.users_collection), None), self._context.scene.collection
        if home is not None and home != root:
            home.objects.link(low)
            root.objects.unlink(low)
        for layer in list(low.data.uv_layers):
            low.data.uv_layers.remove(layer)
        self._meshes.release(low.data)
        return low, notes

    def _searched(self, degrees: float, most: int) -> Task[bpy.types.Object]:
        """The low object of the fewest triangles within a limit, or that of the most triangles if none is within it."""
        tried: list[Tried] = []
        left = 1.0

        def attempt(wanted: int) -> Task[Tried]:
            nonlocal left
            begin, left = left, 0.8 * left
            found = yield from part(self._tried(wanted, degrees), 1.0 - begin, 1.0 - left)
            tried.append(found)
            return found

        first = max(FEWEST, round(SHARE * len(self.high.triangles)))
        within, _ = yield from levels.fewest(first, most, attempt)
        best = within or min(tried, key=lambda each: each.excess)
        for each in tried:
            if each is not best:
                self._meshes.remove(each.low.data)  # and the object with it
        return best.low

    def _tried(self, wanted: int, degrees: float) -> Task[Tried]:
        yield Progress(f"Decimating to {wanted:,} triangles", 0.0)
        low = self._made(wanted)
        yield Progress(f"Unwrapping {wanted:,} triangles", 0.1)
        settings = _to_compare(self._settings, self._context)
        unwrapping.unwrap(low, settings, is_quick=True)
        job = self._job.for_low(low)
        job.is_seen, job.is_exported, job.is_measured, job.is_pictured = True, False, False, False
        check_job(self._context, job, settings)
        drawn, _ = yield from part(draw_raw(self._context, job, Run(settings, self._pace)), 0.2, 1.0)
        if drawn.appearance is None:
            raise NoGpu("This GPU cannot measure the shading error: give a number of triangles in place of degrees.")
        low.hide_set(True)
        self.count += 1
        return Tried(low, len(low.data.polygons), drawn.appearance, degrees)

    def _made(self, triangles: int) -> bpy.types.Object:
        """A low object of about this many triangles."""
        high = self.high
        data = self._meshes.own(decimated(high.base, triangles))
        points, faces = mesh_reader.points(data), mesh_reader.corner_vertices(data).reshape(-1, 3)
        data.vertices.foreach_set("co", fitting.fitted(points, faces, high.around).astype(np.float32).reshape(-1))
        data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
        data.update()
        low = bpy.data.objects.new(TEMPORARY, data)
        self._context.scene.collection.objects.link(low)
        low.matrix_world = Matrix.Translation(high.origin)
        self._context.view_layer.update()
        return low


def decimated(data: bpy.types.Mesh, triangles: int) -> bpy.types.Mesh:
    """A mesh of about this many triangles, by Blender's Decimate. data: of triangles. The caller removes it."""
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, data.copy())
        decimate = obj.modifiers.new(TEMPORARY, "DECIMATE")
        decimate.ratio = min(1.0, triangles / len(data.polygons))
        decimate.use_collapse_triangulate = True
        return temporary.evaluated(scene, obj)


def _to_compare(settings: Settings, context: bpy.types.Context) -> Settings:
    """The settings by which low meshes are compared: the normal map alone, on at most SIDE texels a side."""
    shrink = max(1.0, max(settings.sampling.size) / SIDE)
    return replace(
        settings.read_by(context.scene.render.engine).without_file().without_other_maps(),
        method=Method.CAST,
        width=max(1, round(settings.sampling.width / shrink)),
        height=max(1, round(settings.sampling.height / shrink)),
        samples=1,
        normal=True,
        material=False,
        connect_maps=False,
    )


def _read(context: bpy.types.Context, job: Job, settings: Settings, meshes: temporary.TemporaryMeshes) -> High:
    """Read the high objects, and find out whether their triangles make a surface. Raises BakeError."""
    points, triangles = _triangles(context, job, settings)
    origin = np.array(job.highs[0].matrix_world.translation, np.float64)
    points = (points - origin).astype(np.float32)
    points, triangles = soup.welded(points, triangles)
    if not len(triangles):
        raise BakeError(f"{job.highs[0].name!r} has no faces with an area: choose a mesh that has some.")
    data = meshes.own(_mesh(points, triangles))
    found = soup.edges(triangles)
    if found.against:
        _turn_to_one_side(data)
        triangles = mesh_reader.corner_vertices(data).reshape(-1, 3)
        found = soup.edges(triangles)
    around = fitting.samples(points, triangles, fitting.MOST)
    areas, base = _areas(points, triangles), data
    if found.faults > MOST_FAULTS:
        base = _remeshed(data, float(areas.sum()), around, meshes) or data
    return High(points, triangles, origin, base, base is not data, around, _edge(areas))


def _triangles(context: bpy.types.Context, job: Job, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """All triangles of the high objects with their modifiers and instances: points (V, 3) float64 in world space, and (T, 3)
    int. Raises BakeError."""
    highs = job.highs
    plain = replace(settings.without_other_maps(), method=Method.CAST, detail_maps=False)
    with evaluation.prepared(context, highs[0], highs, None, settings.map.modifiers) as depsgraph:
        read = Reader(depsgraph, highs[0], "", plain).read(dict(enumerate(highs, start=1)))
    points, triangles, first = [], [], 0
    for mesh in read:
        points.append(mesh.positions.astype(np.float64) @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3])
        triangles.append(mesh.vertices[mesh.front_triangles] + first)
        first += len(mesh.positions)
    return np.concatenate(points), np.concatenate(triangles)


def _mesh(points: np.ndarray, triangles: np.ndarray) -> bpy.types.Mesh:
    data = bpy.data.meshes.new(TEMPORARY)
    data.vertices.add(len(points))
    data.vertices.foreach_set("co", np.ascontiguousarray(points, np.float32).reshape(-1))
    data.loops.add(3 * len(triangles))
    data.loops.foreach_set("vertex_index", np.ascontiguousarray(triangles, np.int32).reshape(-1))
    data.polygons.add(len(triangles))
    data.polygons.foreach_set("loop_start", np.arange(0, 3 * len(triangles), 3, dtype=np.int32))
    data.update(calc_edges=True)
    return data


def _turn_to_one_side(data: bpy.types.Mesh) -> None:
    """Turn faces so that neighbors point to the same side, and closed parts outwards."""
    faces = bmesh.new()
    try:
        faces.from_mesh(data)
        bmesh.ops.recalc_face_normals(faces, faces=faces.faces[:])
        faces.to_mesh(data)
    finally:
        faces.free()


def _remeshed(
    data: bpy.types.Mesh, area: float, around: Samples, meshes: temporary.TemporaryMeshes
) -> bpy.types.Mesh | None:
    """The surface of the volume that the triangles enclose, of voxels; None if they enclose none."""
    voxel = math.sqrt(area / VOXELS)
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, data.copy())
        remesh = obj.modifiers.new(TEMPORARY, "REMESH")
        remesh.mode, remesh.voxel_size = "VOXEL", voxel
        obj.modifiers.new(TEMPORARY, "TRIANGULATE")
        result = meshes.own(temporary.evaluated(scene, obj))
    if not result.polygons:
        return None
    corners = mesh_reader.corner_vertices(result).reshape(-1, 3)
    _, _, squares = Surface(mesh_reader.points(result), corners).closest(around.points[::16].astype(np.float32))
    return result if math.sqrt(float(np.percentile(squares, 95))) < FAR * voxel else None


@contextmanager
def _uv_map_of(low: bpy.types.Object) -> Iterator[None]:
    """Remove the UV maps that the block gives to an object, if it fails."""
    uid, before = low.session_uid, {layer.name for layer in low.data.uv_layers}
    is_finished = False
    try:
        yield
        is_finished = True
    finally:
        if not is_finished:
            for obj in [obj for obj in bpy.data.objects if obj.session_uid == uid]:
                for name in [layer.name for layer in obj.data.uv_layers if layer.name not in before]:
                    obj.data.uv_layers.remove(obj.data.uv_layers[name])


def _edge_of(context: bpy.types.Context, job: Job, settings: Settings) -> float:
    """The side of a triangle of middle size of the high objects, in scene units."""
    return _edge(_areas(*_triangles(context, job, settings)))


def _areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _edge(areas: np.ndarray) -> float:
    """The side of an equilateral triangle of middle size."""
    return math.sqrt(4.0 / math.sqrt(3.0) * float(np.median(areas)))


def _size(low: bpy.types.Object, edge: float) -> int:
    """The side of the maps at which a texel is not larger than the high mesh's triangles."""
    layer = low.data.uv_layers.active.name
    mesh = mesh_reader.surface(low.data, layer, low.name, mesh_reader.matrix(low))
    points = mesh.positions.astype(np.float64) @ mesh.to_world[:3, :3].T
    used = uv_stretch.measure(points[mesh.vertices[mesh.triangles]], mesh.uv[mesh.triangles]).used
    return asset.size_for(edge, float(_areas(points, mesh.vertices[mesh.triangles]).sum()), min(used, 1.0))
