# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives low meshes a UV map: cuts a copy into charts in several ways, flattens them, and takes what uses a map best.

The mesh itself only gets the UV map. Its modes, its selection and its seams stay as they are.
"""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import bmesh
import bpy
import numpy as np

from ..audit import mip_gaps
from ..core import foreach
from ..core.errors import BakeError
from ..core.progress import Progress, Task, aside, finish, part
from ..core.settings import SamplingSettings, Settings
from ..mesh import topology, uv_charts, uv_islands, uv_packing, uv_stacks, uv_stretch
from ..mesh.edges import is_without_area
from ..mesh.topology import EdgeTable
from ..mesh.triangle_mesh import Mesh
from ..mesh.triangles import face_areas
from ..mesh.uv_charts import ChartOptions
from ..mesh.uv_packing import PackOptions
from ..mesh.uv_stretch import Layout
from ..scene import mesh_reader, object_checks
from ..scene.mesh_elements import UNPAINTED
from ..scene.object_checks import ObjectRef
from . import flattening, temporary
from .flattening import Flattened, Flattener, editing

NAME = "UVMap"
"""Of the new UV map, as Blender calls it."""
MOST = 8
"""UV maps of a mesh, in Blender."""
STIFF, STEPS, COARSE = (10.0, 1.0), (10.0, 3.0, 1.0, 0.4, 0.15), (1.0, 0.4)
"""The steps in which charts grow: how much stretch counts. In the first ones, all bends count as stretch. Each chart of the
last step is taken, or parts of it. Meshes of many faces, and those that are unwrapped quickly, have the last steps."""
PRICES = (0.4, 1.0, 2.5)
"""What borders cost, as factors on their price: what packing makes of them shows when it is done."""
SIDES = (0.95, 0.6)
"""Longer islands than these shares of the map's side are also halved."""
CLOSE = 0.98
"""Of ways that reach this share of the best figure, the one with the fewest islands is taken."""
NEAR = 0.92
"""As CLOSE, after a quick packing."""
FEW, FINALISTS = 5000, 3
"""Meshes with so many triangles have fewer ways. Of others, so many ways are relaxed and packed with care, at most."""
MUCH, FULL = 1.4, 0.85
"""More islands than Smart Project makes are taken only if the figure is better by this factor. No
figure is above the second number, nearly."""
STRAIGHT = 0.98
"""Straight strips are taken if they leave this share of the figure."""
NEIGHBORS = 4
"""With so many neighbors a small chart is joined, one after the other, until that pays."""
JOINED = 0.995
"""Joined small charts are taken if they leave this share of the figure."""
CHARTS, SMART = "charts", "Smart Project"
"""Names of ways."""
ANGLE = np.radians(66.0)
"""The angle between faces from which Smart Project cuts, as Blender has it."""


@dataclass(frozen=True)
class Unwrapped:
    """A way to unwrap, and what it gave.

    Attributes:
        name: Of the way, for messages.
        flattened: Its islands.
        seams: The edges that are cut in any case, as vertices; None for none.
    """

    name: str
    flattened: Flattened
    seams: np.ndarray | None = None


@dataclass(frozen=True)
class Packed:
    """UVs in the map.

    Attributes:
        way: What is packed.
        uv: Of each corner, float32.
        layout: How they use the map.
        stacked: The share of the faces that have the UVs of others.
    """

    way: Unwrapped
    uv: np.ndarray
    layout: Layout
    stacked: float = 0.0

    @property
    def sentence(self) -> str:
        """The figures, as a clause."""
        layout = self.layout
        return (
            f"{layout.islands:,} islands by {self.way.name}, {layout.used:.0%} of the map used, "
            f"stretch {layout.angle:.2f} (angles), {layout.area:.2f} (areas)"
            + f", {self.stacked:.0%} of the faces on others"
            * (self.stacked > 0.0)
        )


def unwrap(low: bpy.types.Object, settings: Settings, *, is_quick: bool = False) -> str:
    """`work`, done at once."""
    return finish(work(low, settings, is_quick=is_quick))


def work(
    low: bpy.types.Object,
    settings: Settings,
    *,
    is_quick: bool = False,
    stacks: bool = False,
    weights: np.ndarray | None = None,
) -> Task[str]:
    """Give an object's own mesh a UV map, the active one. Returns a sentence about it.

    Raises BakeError if no way works. Then, and if it is closed before its end, nothing has changed.

    Args:
        is_quick: whether only one way is tried.
        stacks: whether mirrored halves and equal parts are on the same place.
        weights: (V,) float32 from 0 to 1, of the vertices, whose mean over an island is its texel density: see `density`.
    """
    ref = ObjectRef.of(low)
    found = yield from find(low, settings.sampling, is_quick=is_quick, stacks=stacks, weights=weights)
    return apply(ref.resolve(), found)


def find(
    low: bpy.types.Object,
    sampling: SamplingSettings,
    *,
    is_quick: bool = False,
    stacks: bool = False,
    weights: np.ndarray | None = None,
) -> Task[Packed]:
    """The best UV map of an object's own mesh, which stays as it is. As `work`."""
    check(low)
    name = low.name
    best = yield from _best(low, sampling, is_quick=is_quick, stacks=stacks, weights=weights)
    if best is None:
        raise BakeError(f"{name!r} cannot be unwrapped: its faces have no area.")
    return best


def density(weights: np.ndarray) -> np.ndarray:
    """The texel density by length, as a factor, for weights from 0 to 1: half of it for 0, as without for 0.5, twice for 1."""
    return 4.0 ** (weights - UNPAINTED)


def is_unwrapped(low: bpy.types.Object, layer: str = "") -> bool:
    """Whether an object's own mesh has a UV map that covers any texel. layer: its name; empty for the active one."""
    if not low.data.uv_layers:
        return False
    if layer not in low.data.uv_layers:
        layer = mesh_reader.active_uv_layer(low.data)
    corners = mesh_reader.uvs(low.data, layer)[mesh_reader.triangles(low.data)].astype(np.float64)
    corners = corners[np.isfinite(corners).all(axis=(1, 2))]
    return bool(np.linalg.det(corners[:, 1:] - corners[:, :1]).any())


def check(low: bpy.types.Object) -> None:
    """Raise BakeError for what keeps an object from being unwrapped, and shows at once."""
    if low.type != "MESH" or not low.data.polygons:
        raise BakeError(f"{low.name!r} has no faces: choose a mesh that has some.")
    if len(low.data.uv_layers) == MOST:
        raise BakeError(f"{low.name!r} has as many UV maps as a mesh can have: remove one.")


def apply(low: bpy.types.Object, found: Packed) -> str:
    """Give an object's own mesh the UV map that was found for it. Returns a sentence. Raises BakeError if it has other faces
    by now."""
    if len(low.data.uv_layers) == MOST or 2 * len(low.data.loops) != found.uv.size:
        raise BakeError(f"{low.name!r} has changed meanwhile: unwrap it again.")
    shows_textures = bool(low.data.uv_layers) and bool(object_checks.textures_of(low))
    layer = low.data.uv_layers.new(name=NAME, do_init=False)
    layer.uv.foreach_set("vector", found.uv.reshape(-1))
    low.data.uv_layers.active = layer
    if not shows_textures:  # else these stay where they are, and a bake moves them
        layer.active_render = True
    low.data.update()
    return f"{low.name!r} is unwrapped: {found.sentence}"


def _best(
    low: bpy.types.Object, sampling: SamplingSettings, *, is_quick: bool, stacks: bool, weights: np.ndarray | None
) -> Task[Packed | None]:
    """The best UVs for an object's own mesh; None if it has no area."""
    with _copy(low) as obj:
        yield Progress("Cutting into charts", 0.0)
        mesh = _read(obj)
        if is_without_area(mesh):
            return None
        starts, materials = (foreach.read(obj.data.polygons, name) for name in ("loop_start", "material_index"))
        copies = uv_stacks.copies(mesh, starts, materials) if stacks else None
        of_faces = None if weights is None else _of_faces(mesh, weights, len(starts))
        if copies is not None:
            _remove(obj.data, copies.is_copy)
            mesh = _read(obj)
            of_faces = None if of_faces is None else of_faces[~copies.is_copy]
        best = yield from _found(_Unwrapping(obj, mesh, sampling, of_faces), mesh, is_quick=is_quick)
        if copies is None or best is None:
            return best
        numbers = np.cumsum(copies.corners == np.arange(len(copies.corners))) - 1  # of the corners that are left
        return replace(best, uv=best.uv[numbers[copies.corners]], stacked=float(copies.is_copy.mean()))


def _found(unwrapping: "_Unwrapping", mesh: Mesh, *, is_quick: bool) -> Task[Packed | None]:
    """The best UVs for a mesh; None if it has no area."""
    ways = yield from part(unwrapping.ways(is_quick=is_quick), 0.0, 0.6)
    packed = yield from part(unwrapping.all_packed(ways), 0.6, 0.65)
    if max(each.layout.figure for each in packed) == 0.0:
        return None
    if is_quick:
        return max(packed, key=lambda each: each.layout.figure)
    if len(mesh.faces) < FEW:
        ways = yield from part(unwrapping.shorter(packed), 0.65, 0.7)
        packed += yield from part(unwrapping.all_packed(ways), 0.7, 0.75)
    packed = unwrapping.without_many(packed)
    near = [each for each in packed if each.layout.figure >= NEAR * packed[0].layout.figure]
    fewest = min(near, key=lambda each: each.layout.islands)
    finalists = [each for each in near if each is not fewest][: FINALISTS - 1 if len(mesh.faces) < FEW else 0]
    finalists.append(fewest)
    last = [each for each in packed if each.way.name == SMART]
    for done, each in enumerate(finalists):
        here, there = (0.75 + 0.25 * step / len(finalists) for step in (done, done + 1))
        last.append((yield from part(unwrapping.finished(each), here, there)))
    # The one with the fewest islands of those that are close to the best, and no worse than Smart Project.
    least = max(each.layout.figure * (1.0 if each.way.name == SMART else CLOSE) for each in last)
    good = [each for each in last if each.layout.figure >= least]
    best = min(good, key=lambda each: (each.layout.islands, -each.layout.figure))
    alike = yield from unwrapping.mirrored(best)
    return best if alike is None or alike.layout.figure < least else alike


def _of_faces(mesh: Mesh, weights: np.ndarray, count: int) -> np.ndarray:
    """The mean weights (F,) of faces, by those (V,) of vertices."""
    corners = mesh.vertices[mesh.triangles]
    areas, means = face_areas(mesh.positions[corners]), weights[corners].mean(axis=1)
    totals = np.bincount(mesh.faces, areas, count)
    sums = np.bincount(mesh.faces, areas * means, count)
    return np.divide(sums, totals, out=np.full(count, UNPAINTED), where=totals > 0.0)


def _different(ways: list[Unwrapped]) -> list[Unwrapped]:
    """Without those that have the same charts as an earlier one."""
    keys = [topology.first_rows(way.flattened.labels[:, None]).tobytes() for way in ways]
    return [way for number, way in enumerate(ways) if keys.index(keys[number]) == number]


def _side_lengths(uv: np.ndarray) -> np.ndarray:
    """The lengths (T, 3) of the sides of triangles (T, 3, 2)."""
    return np.linalg.norm(np.roll(uv, -1, axis=1) - uv, axis=2)


def _remove(data: bpy.types.Mesh, chosen: np.ndarray) -> None:
    """Remove the chosen faces (F,) bool from a mesh. All others stay in their order."""
    edited = bmesh.new()
    try:
        edited.from_mesh(data)
        bmesh.ops.delete(edited, geom=list(itertools.compress(edited.faces, chosen.tolist())), context="FACES")
        edited.to_mesh(data)
    finally:
        edited.free()


def margin(sampling: SamplingSettings) -> float:
    """The margin around islands that the clean mip levels of the settings need, as a share of the map's side."""
    return mip_gaps.needed(sampling) / 2.0 / min(sampling.size)


def _edges(data: bpy.types.Mesh, marked: str) -> np.ndarray:
    """The edges that are marked, as vertices (N, 2)."""
    ends, chosen = np.empty((len(data.edges), 2), np.int32), np.empty(len(data.edges), bool)
    data.edges.foreach_get("vertices", ends.reshape(-1))
    data.edges.foreach_get(marked, chosen)
    return ends[chosen]


def _read(obj: bpy.types.Object) -> Mesh:
    return mesh_reader.surface(obj.data, mesh_reader.active_uv_layer(obj.data), obj.name, np.eye(4), with_faces=True)


def _points(mesh: Mesh) -> np.ndarray:
    return mesh.positions[mesh.vertices[mesh.triangles]]


class _Unwrapping:
    """A mesh, and the ways to unwrap it."""

    def __init__(
        self, obj: bpy.types.Object, mesh: Mesh, sampling: SamplingSettings, weights: np.ndarray | None = None
    ):
        """weights: (F,), of faces, for `density`; None where all have the same."""
        self._obj, self._mesh, self._sampling, self._weights = obj, mesh, sampling, weights
        self._seams = _edges(obj.data, "use_seam")
        wanted = np.concatenate([self._seams, _between_materials(obj.data, mesh)])
        # At a border, half of half a texel is another island's.
        margin_and_blur = margin(sampling) + 0.25 / min(sampling.size)
        options = ChartOptions(margin_and_blur, hard=_edges(obj.data, "use_edge_sharp"), wanted=wanted)
        self._flattener = Flattener(mesh, obj.data, options)
        self._most = 0  # islands of Smart Project

    def ways(self, *, is_quick: bool) -> Task[list[Unwrapped]]:
        """The ways to unwrap, as they share a map best, not packed."""
        flattener = self._flattener
        is_small = len(self._mesh.faces) < FEW and not is_quick
        levels = yield from part(self._levels(STEPS if is_small else COARSE, is_draft=not is_small), 0.0, 0.7)
        ways = []
        for price in (1.0,) if is_quick else PRICES if is_small else PRICES[1:]:
            yield Progress("Unwrapping", 0.7)
            ways.append(self._best_parts(levels, price))
        if not is_quick:
            yield Progress("Unwrapping", 0.7)
            labels = self._smart()
            self._most = int(labels.max()) + 1
            smart = yield from part(flattener.sound(labels, is_draft=not is_small), 0.7, 0.75)
            ways += [self._best_parts(levels[: len(STIFF)], 1.0), Unwrapped(SMART, smart)]
            if len(self._seams):
                labels = flattener.charts.between(self._seams)
                found = yield from part(flattener.sound(labels, self._seams), 0.75, 0.8)
                ways.append(Unwrapped("the mesh's seams", found, self._seams))
        return _different(ways)

    def shorter(self, packed: list[Packed]) -> Task[list[Unwrapped]]:
        """Ways without islands that are long for the map, if they may be better."""
        flattener, ways = self._flattener, [each.way for each in packed]
        room = FULL / max(each.layout.figure for each in packed)
        if min(each.layout.islands for each in packed) >= self._most and room < MUCH:
            return []
        side, shorter = np.sqrt(flattener.charts.areas.sum() / uv_charts.FULL), []
        for way in ways:
            for share in SIDES:
                known = way.flattened
                done = len(shorter) / len(ways) / len(SIDES)
                work = flattener.sound(known.labels, way.seams, known, side=share * side)
                found = yield from part(work, done, done + 1.0 / len(ways) / len(SIDES))
                shorter.append(replace(way, flattened=found))
        return _different([*ways, *shorter])[len(ways) :]

    def _levels(self, last: tuple[float, ...], *, is_draft: bool) -> Task[list[Flattened]]:
        """Charts that grow, from level to level. last: the last steps. is_draft: whether projections do for the first level."""
        charts, steps, levels = self._flattener.charts, (*STIFF, *last), []
        labels = charts.flat()
        for done, stretch in enumerate(steps):
            step = Progress("Unwrapping", done / len(steps))
            grown = partial(charts.grown, labels, stretch, is_stiff=done < len(STIFF), most=flattening.MOST)
            labels = yield from aside(grown, step)
            yield step
            if levels:
                work = self._flattener.flattened(labels, known=levels[-1])
            else:
                labels = charts.whole(charts.straightened(labels, stretch))
                work = self._flattener.sound(labels, is_draft=is_draft)
            levels.append((yield from part(work, done / len(steps), (done + 1) / len(steps))))
            labels = levels[-1].labels
        return levels

    def _best_parts(self, levels: list[Flattened], price: float) -> Unwrapped:
        """Charts as large as it pays. price: a factor on that of borders."""
        costs = [2.0 * each.stretch + price * self._prices(each) for each in levels]
        level, labels = uv_charts.best_parts([each.labels for each in levels], costs)
        return Unwrapped(CHARTS, self._flattener.joined(levels, level, labels))

    def _prices(self, flattened: Flattened) -> np.ndarray:
        return self._flattener.charts.prices(flattened.labels, flattened.nodes[self._mesh.triangles])

    def _smart(self) -> np.ndarray:
        """The islands of Smart Project, as labels."""
        with editing(self._obj):
            bpy.ops.uv.smart_project(angle_limit=ANGLE, island_margin=0.0, area_weight=0.0, correct_aspect=False)
        mesh = _read(self._obj)
        labels = np.zeros(self._flattener.charts.count, np.int64)
        labels[mesh.faces] = uv_islands.islands(mesh)
        return self._flattener.charts.whole(labels)

    def all_packed(self, ways: list[Unwrapped]) -> Task[list[Packed]]:
        """All ways packed quickly."""
        packed = []
        for done, way in enumerate(ways):
            here, there = (step / len(ways) for step in (done, done + 1))
            packed.append((yield from part(self.packed(way, is_quick=True), here, there)))
        return packed

    def without_many(self, packed: list[Packed]) -> list[Packed]:
        """Those with no more islands than Smart Project makes, the best first; all, if these are much worse."""
        packed = sorted(packed, key=lambda each: -each.layout.figure)
        few = [each for each in packed if each.layout.islands <= self._most]
        return few if few and few[0].layout.figure * MUCH >= packed[0].layout.figure else packed

    def finished(self, packed: Packed) -> Task[Packed]:
        """With borders that are shorter, with less stretch, with strips that are straight: what comes of it."""
        way = yield from part(self._smoothed(packed.way), 0.0, 0.1)
        way = yield from part(self._without_crumbs(way), 0.1, 0.3)
        way = replace(way, flattened=(yield from part(self._flattener.relaxed(way.flattened), 0.3, 0.6)))
        last = yield from part(self.packed(way), 0.6, 0.8)
        best = max(packed, last, key=lambda each: each.layout.figure)
        straight = self.straightened(best.way)
        if straight is not None:
            last = yield from part(self.packed(straight), 0.8, 1.0)
            best = last if last.layout.figure >= STRAIGHT * best.layout.figure else best
        return best

    def _smoothed(self, way: Unwrapped) -> Task[Unwrapped]:
        """With borders that are shorter, if that pays."""
        charts, before = self._flattener.charts, way.flattened
        labels = charts.whole(charts.straightened(before.labels, STEPS[0]))
        if way.name != CHARTS or np.array_equal(labels, before.labels):
            return way
        after = yield from self._flattener.flattened(labels, known=before)
        costs = [(2.0 * each.stretch + self._prices(each)).sum() for each in (before, after)]
        return replace(way, flattened=after) if costs[1] < costs[0] else way

    def _without_crumbs(self, way: Unwrapped) -> Task[Unwrapped]:
        """With charts whose borders cost more than their areas joined with others, where that pays."""
        charts, flattened = self._flattener.charts, way.flattened
        for rank in range(NEIGHBORS if way.name == CHARTS else 0):
            areas = np.bincount(flattened.labels, charts.areas, len(flattened.stretch))
            labels = charts.absorbed(flattened.labels, self._prices(flattened) > areas, rank)
            if len(flattened.stretch) == labels.max(initial=-1) + 1:
                continue
            here, there = (step / NEIGHBORS for step in (rank, rank + 1))
            joined = yield from part(self._flattener.flattened(labels, known=flattened), here, there)
            flattened = self._best_parts([flattened, joined], 1.0).flattened
        if len(flattened.stretch) == len(way.flattened.stretch):
            return way
        before, after = yield from self.all_packed([way, replace(way, flattened=flattened)])
        return after.way if after.layout.figure >= JOINED * before.layout.figure else way

    def mirrored(self, packed: Packed) -> Task[Packed | None]:
        """With charts that are one another's mirror, if the mesh is its own; None if they are already, or cannot be."""
        yield Progress("Unwrapping", 1.0)
        data = self._obj.data
        starts, materials = (foreach.read(data.polygons, name) for name in ("loop_start", "material_index"))
        mirror = uv_stacks.mirror(self._mesh, starts, materials)
        if mirror is None:
            return None
        known, found, keys = packed.way.flattened, [], set()
        most = max(self._most, packed.layout.islands)
        for is_cut, side in itertools.product((False, True), (1, -1)):
            each = replace(mirror, sides=side * mirror.sides)
            flattened = yield from self._flattener.mirrored(known, each, packed.way.seams, is_cut=is_cut)
            if flattened is known:
                return None
            if flattened is None or len(flattened.stretch) > most:
                continue
            key = side, topology.first_rows(flattened.labels[:, None]).tobytes()
            if key not in keys:  # cuts in the plane may change nothing
                keys.add(key)
                way = replace(packed.way, flattened=flattened)
                quick = yield from self.packed(way, is_quick=True)
                found.append((quick.layout.figure, -len(found), way, each))
        if not found:
            return None
        _, _, way, mirror = max(found)
        flattened = yield from self._flattener.relaxed(way.flattened)
        way = replace(way, flattened=self._flattener.images(flattened, mirror))
        straight = self.straightened(way) if self.straightened(packed.way) is None else None
        if straight is not None:
            way = replace(way, flattened=self._flattener.images(straight.flattened, mirror))
        return (yield from self.packed(way))

    def straightened(self, way: Unwrapped) -> Unwrapped | None:
        """With strips of quads that are straight; None if there are none that were not."""
        flattened = self._flattener.straightened(way.flattened)
        before, after = (_side_lengths(each.uv[self._mesh.triangles]) for each in (way.flattened, flattened))
        return None if np.allclose(before, after, 1e-3, 1e-3 * before.mean()) else replace(way, flattened=flattened)

    def packed(self, way: Unwrapped, *, is_quick: bool = False) -> Task[Packed]:
        """Pack a way's islands."""
        triangles, flattened, points = self._mesh.triangles, way.flattened, _points(self._mesh)
        islands, before = flattened.labels[self._mesh.faces], flattened.uv
        if self._weights is not None:  # faces that shall be denser are measured as if they were larger
            factors = np.ones((len(before), 1))
            factors[triangles] = self._densities(flattened.labels)[islands][:, None, None]
            before = before * factors
            points = points * density(self._weights)[self._mesh.faces][:, None, None]
        options = PackOptions(margin(self._sampling), islands, is_quick)
        uv = yield from uv_packing.work(before, triangles, options)
        if uv is None:
            uv = self._boxed(before)
        uv = uv.astype(np.float32)
        corners = self._mesh.vertices[triangles]
        side = min(self._sampling.size)
        layout = uv_stretch.measure(points, uv[triangles], side, corners, is_sound=True)
        return Packed(way, uv, layout)

    def _densities(self, labels: np.ndarray) -> np.ndarray:
        """The texel density (N,) that each chart has, by the mean of its weights."""
        areas = self._flattener.charts.areas
        totals, sums = np.bincount(labels, areas), np.bincount(labels, areas * self._weights)
        return density(np.divide(sums, totals, out=np.full(len(totals), UNPAINTED), where=totals > 0.0))

    def _boxed(self, uv: np.ndarray) -> np.ndarray:
        """The UVs packed by boxes."""
        layer = self._obj.data.uv_layers.active
        layer.uv.foreach_set("vector", np.ascontiguousarray(uv, np.float32).reshape(-1))
        with editing(self._obj):
            pack_boxes(margin(self._sampling))
        result = np.empty((len(uv), 2), np.float32)
        self._obj.data.uv_layers.active.uv.foreach_get("vector", result.reshape(-1))
        return result


def _between_materials(data: bpy.types.Mesh, mesh: Mesh) -> np.ndarray:
    """The edges between materials, as vertices (N, 2)."""
    table = EdgeTable.of(mesh.vertices[mesh.triangles])
    one, other = table.pairs
    of = foreach.read(data.polygons, "material_index")[mesh.faces]
    return table.ends[table.counts == 2][of[one // 3] != of[other // 3]]


def pack_boxes(margin: float) -> None:
    """Pack islands with a margin around each, as a share of the map's side: the distance between two is twice as large.

    By boxes: the packing by outlines takes minutes for hundreds of islands.
    """
    # An exact margin makes Blender try few layouts, and one that is added before all is scaled makes it try more. Once islands
    # have about their final size, both are the same.
    for method in ("FRACTION", "ADD", "ADD"):
        bpy.ops.uv.pack_islands(
            rotate=True, scale=True, margin_method=method, margin=margin, shape_method="AABB", merge_overlap=False
        )


@contextmanager
def _copy(low: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """A copy of the object's own mesh, in the proportions that the object gives it, with a new UV map, in a scene of its own.

    It is of size 1 and around the object's origin, or around its own middle along axes on which that is beyond it: single
    precision is enough, and planes of mirrors stay where they are. Vertices that are not finite are at the origin.
    """
    with temporary.scene() as scene:
        data = low.data.copy()
        data.uv_layers.active = data.uv_layers.new(name=NAME, do_init=False)  # others may not be finite
        obj = temporary.add_object(scene, data)
        obj.shape_key_clear()  # Edit Mode would begin with the points of a key
        points = foreach.vectors(data.vertices, "co") @ _proportions(np.array(low.matrix_world.to_3x3(), np.float64))
        is_finite = np.isfinite(points).all(axis=1)
        known = points[is_finite] if is_finite.any() else np.zeros((1, 3))
        lowest, highest = known.min(axis=0), known.max(axis=0)
        middle = np.where((lowest < 0.0) & (highest > 0.0), 0.0, 0.5 * (lowest + highest))
        points = (points - middle) / max((highest - lowest).max(), 1e-300)
        points[~is_finite] = 0.0
        data.vertices.foreach_set("co", points.astype(np.float32).reshape(-1))
        data.update()
        yield obj


def _proportions(linear: np.ndarray) -> np.ndarray:
    """A symmetric matrix (3, 3) that changes lengths as `linear` (3, 3) does, and turns nothing: axes that are scaled stay."""
    _, sizes, axes = np.linalg.svd(np.nan_to_num(linear, nan=0.0, posinf=0.0, neginf=0.0))
    return (axes.T * sizes) @ axes
