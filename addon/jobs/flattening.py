# SPDX-License-Identifier: GPL-3.0-or-later
"""Flattens charts of a mesh: flat ones by projection, others by Blender's operators, a few thousand faces at a time.

Blender unwraps copies of the charts, whose vertices are split where the charts end, so that seams, fans and faces that lie on
each other need no care.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..core import foreach
from ..core.progress import Progress, Task, part
from ..mesh import topology, uv_crossings, uv_stretch, uv_strips
from ..mesh.topology import numbered
from ..mesh.triangle_mesh import Mesh
from ..mesh.uv_charts import ChartOptions, Charts
from ..mesh.uv_stacks import Mirror
from ..scene import mesh_writer
from . import temporary

ANGLES, STRETCH = "ANGLE_BASED", "MINIMUM_STRETCH"
"""Blender's ways: quick, and with less stretch; the second one does not fold."""
ITERATIONS, FEWEST, MANY = 12, 6, 15000
"""Of the second way: 40 leave no less stretch that shows. Fewer for many faces, but at least the second number, so that both
multiplied are at most the third one: a step must be short, and of large charts little stretch is left."""
AT_ONCE, MOST = 2000, 4000
"""Faces that Blender unwraps in one step, about, and those of a chart, at most: an operator answers no Esc. Charts of more
faces are only projected."""
LEAST = 0.002
"""The share of a chart's area that stretch costs and that does not count."""
MIRRORINGS = 3
"""How often charts are cut as their mirror images are, and those that fold or overlap are halved."""
HALVINGS = 12
"""How often charts that fold or overlap are halved, until each of their faces is a chart."""


@dataclass(frozen=True, eq=False)
class Flattened:
    """Charts and their UVs, each by itself.

    Attributes:
        labels: (F,) int from 0, the chart of each face.
        uv: (C, 2) float64, of corners, in units of the surface, scaled so that charts share a map best.
        nodes: (C,) int, the UV vertex of each corner.
        stretch: (N,) float64, the area of the map that stretch costs, by charts; infinite for those that fold or overlap.
    """

    labels: np.ndarray
    uv: np.ndarray
    nodes: np.ndarray
    stretch: np.ndarray

    @property
    def is_bad(self) -> np.ndarray:
        """Which charts (N,) bool fold or overlap."""
        return np.isinf(self.stretch)


class Flattener:
    """Flattens charts of a mesh, which are labels (F,) int from 0 of its faces.

    Attributes:
        mesh: With the faces and the corners of the object's mesh.
        charts: Its charts.
    """

    def __init__(self, mesh: Mesh, data: bpy.types.Mesh, options: ChartOptions):
        """data: what `mesh` was read from. options: for charts, with the faces of the mesh."""
        self.mesh = mesh
        triangles = mesh.vertices[mesh.triangles]
        self.charts = Charts(mesh.positions, triangles, replace(options, faces=mesh.faces))
        self._starts, self._sizes = (foreach.read(data.polygons, name) for name in ("loop_start", "loop_total"))
        self._starts, self._sizes = self._starts[: self.charts.count], self._sizes[: self.charts.count]
        self._points = mesh.positions.astype(np.float64)[mesh.vertices]  # of corners
        self._has_triangles = np.bincount(mesh.faces, minlength=self.charts.count) > 0

    def flattened(
        self,
        labels: np.ndarray,
        seams: np.ndarray | None = None,
        known: Flattened | None = None,
        *,
        is_draft: bool = False,
    ) -> Task[Flattened]:
        """Flatten charts.

        Args:
            labels: (F,) int from 0.
            seams: (S, 2) int, edges that are cut as well.
            known: of charts some of which may be the same.
            is_draft: whether projections do, where they neither fold nor overlap.
        """
        yield Progress("Unwrapping", 0.0)
        same, kept = np.zeros(int(labels.max(initial=-1)) + 1, bool), known
        if known is not None:
            same = _same(labels, known.labels)
            stretch = np.zeros(len(same))
            stretch[labels] = known.stretch[known.labels]
            kept = replace(known, labels=labels, stretch=stretch)
            if same.all() and not kept.is_bad.any():
                return kept
        nodes = self.charts.nodes(labels, self.mesh.triangles, seams)
        yield Progress("Unwrapping", 0.05)
        result = self._measured(labels, self._projected(labels), nodes, ~same)
        yield Progress("Unwrapping", 0.1)
        is_left = result.is_bad if is_draft else self._is_stretched(result)
        if kept is not None:
            result = self._taken(result, kept, same)
            is_left = np.where(same, result.is_bad, is_left)
        is_left &= np.bincount(labels) > 1
        result = yield from part(self._unwrapped(result, is_left, ANGLES), 0.1, 0.6)
        return (yield from part(self._unwrapped(result, is_left & result.is_bad, STRETCH), 0.6, 1.0))

    def sound(
        self,
        labels: np.ndarray,
        seams: np.ndarray | None = None,
        known: Flattened | None = None,
        *,
        side: float = np.inf,
        is_draft: bool = False,
    ) -> Task[Flattened]:
        """As `flattened`; charts that fold, overlap or are longer than `side` are halved until none is, and so are charts of
        too many faces whose stretch counts."""
        result = yield from part(self.flattened(labels, seams, known, is_draft=is_draft), 0.0, 0.5)
        left = 0.5
        for number in range(HALVINGS + 1):
            yield Progress("Unwrapping", 1.0 - left)
            bad = result.is_bad
            is_long = self._extents(result) > np.where(self.charts.is_flat(result.labels), 2.0, 1.0) * side
            sizes = np.bincount(result.labels)
            wrong = (bad | is_long | (self._is_stretched(result) & (sizes > MOST))) & (sizes > 1)
            if not wrong.any():
                break
            if number < HALVINGS:
                centers = np.where(bad[result.labels][:, None], self.charts.centers, self._centers(result))
                labels = self.charts.halved(result.labels, wrong, centers)
            else:
                alone = np.where((wrong & bad)[result.labels], len(bad) + np.arange(len(result.labels)), result.labels)
                labels = numbered(alone)[1]
            again = self.flattened(labels, seams, result, is_draft=is_draft)
            result = yield from part(again, 1.0 - left, 1.0 - 0.5 * left)
            left *= 0.5
        return result

    def relaxed(self, flattened: Flattened) -> Task[Flattened]:
        """With less stretch, where Blender finds some."""
        return (yield from self._unwrapped(flattened, self._is_stretched(flattened), STRETCH))

    def mirrored(
        self, flattened: Flattened, mirror: Mirror, seams: np.ndarray | None = None, *, is_cut: bool = False
    ) -> Task[Flattened | None]:
        """With charts below the plane of a mirror that are images of those above; None if some fold or overlap.

        is_cut: whether charts end in the plane.
        """
        vertices = np.full(len(self.mesh.positions), -1)
        here = np.flatnonzero(mirror.corners >= 0)
        vertices[self.mesh.vertices[here]] = self.mesh.vertices[mirror.corners[here]]
        sides = np.where(mirror.faces >= 0, mirror.sides, 0)
        result = flattened
        for number in range(MIRRORINGS):
            here, there = (step / MIRRORINGS for step in (number, number + 1))
            wrong = result.is_bad & (np.bincount(result.labels) > 1)
            labels = self.charts.halved(result.labels, wrong) if number else result.labels
            labels = self.charts.mirrored(labels, vertices, sides, is_cut=is_cut)
            if not number and len(wrong) == labels.max(initial=-1) + 1 and _same(labels, flattened.labels).all():
                return flattened
            result = yield from part(self.flattened(labels, seams, result), here, there)
            result = self.images(result, mirror)
            if not result.is_bad.any():
                return result
        return None

    def images(self, flattened: Flattened, mirror: Mirror) -> Flattened:
        """With UVs of charts below the plane of a mirror that are images of those above."""
        labels, faces = flattened.labels, mirror.faces
        other = np.where(faces >= 0, labels[faces], -1)
        count = int(labels.max(initial=-1)) + 1
        partner = np.full(count, -1)
        partner[labels] = other
        differs = (other != partner[labels]) | (mirror.sides >= 0)
        is_image = (np.bincount(labels, differs, count) == 0.0) & (partner >= 0)
        sizes = np.bincount(labels, minlength=count)
        is_image[is_image] = sizes[is_image] == sizes[partner[is_image]]
        corners = topology.ranges(self._starts, self._sizes)[np.repeat(is_image[labels], self._sizes)]
        uv, nodes = flattened.uv.copy(), flattened.nodes.copy()
        uv[corners] = uv[mirror.corners[corners]] * (-1.0, 1.0)
        nodes[corners] = int(nodes.max(initial=-1)) + 1 + nodes[mirror.corners[corners]]
        return self._measured(labels, uv, numbered(nodes)[1])

    def _is_stretched(self, flattened: Flattened) -> np.ndarray:
        """Which charts (N,) bool have stretch that counts."""
        areas = np.bincount(flattened.labels, self.charts.areas, len(flattened.stretch))
        return flattened.stretch > LEAST * areas

    def _centers(self, flattened: Flattened) -> np.ndarray:
        """Where faces are in UV space, (F, 3) with 0 at the end."""
        corners = topology.ranges(self._starts, self._sizes)
        sums = topology.sums_of(
            np.repeat(np.arange(len(self._sizes)), self._sizes), flattened.uv[corners], len(self._sizes)
        )
        return np.insert(sums / self._sizes[:, None], 2, 0.0, axis=1)

    def _extents(self, flattened: Flattened) -> np.ndarray:
        """The longer side (N,) of the squarest box around each chart."""
        corners, of = topology.ranges(self._starts, self._sizes), np.repeat(flattened.labels, self._sizes)
        order = np.argsort(of, kind="stable")
        points, begins = flattened.uv[corners[order]], np.flatnonzero(np.diff(of[order], prepend=-1))
        result = np.full(len(begins), np.inf)
        for turn in np.arange(0.0, 0.5 * np.pi, np.pi / 12.0):
            turned = points @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            extent = np.maximum.reduceat(turned, begins) - np.minimum.reduceat(turned, begins)
            result = np.minimum(result, extent.max(axis=1))
        return result

    def straightened(self, flattened: Flattened) -> Flattened:
        """With grids of quads as rectangles."""
        uv = uv_strips.straighten(self.mesh, flattened.uv, flattened.nodes, flattened.labels[self.mesh.faces])
        is_new = np.zeros(len(flattened.stretch), bool)
        islands, triangles = flattened.labels[self.mesh.faces], self.mesh.triangles
        is_new[islands[(uv != flattened.uv)[triangles].any(axis=(1, 2))]] = True
        straight = self._measured(flattened.labels, uv, flattened.nodes)
        return self._taken(flattened, straight, is_new & ~straight.is_bad)

    def joined(self, levels: list[Flattened], level: np.ndarray, labels: np.ndarray) -> Flattened:
        """Charts from several levels. level: (F,) int, from which each face is. labels: (F,) int, of all together."""
        uv, nodes = np.zeros_like(levels[0].uv), np.zeros_like(levels[0].nodes)
        stretch = np.zeros(int(labels.max(initial=-1)) + 1)
        every, of = topology.ranges(self._starts, self._sizes), np.repeat(level, self._sizes)
        for number, each in enumerate(levels):
            corners = every[of == number]
            uv[corners], nodes[corners] = each.uv[corners], each.nodes[corners]
            faces = np.flatnonzero(level == number)
            stretch[labels[faces]] = each.stretch[each.labels[faces]]
        return Flattened(labels, uv, nodes, stretch)

    def _unwrapped(self, before: Flattened, chosen: np.ndarray, method: str) -> Task[Flattened]:
        """With some charts unwrapped by Blender, where that is better."""
        chosen = chosen & (np.bincount(before.labels) <= MOST)
        faces = np.flatnonzero(chosen[before.labels] & self._has_triangles)
        if not len(faces):
            return before
        sizes = np.bincount(before.labels[faces], minlength=len(chosen))
        groups = (np.cumsum(sizes) - sizes) // AT_ONCE
        faces = faces[np.argsort(groups[before.labels[faces]], kind="stable")]
        uv = before.uv.copy()
        blocks = np.split(faces, np.flatnonzero(np.diff(groups[before.labels[faces]])) + 1)
        for done, block in enumerate(blocks):
            yield Progress("Unwrapping", done / len(blocks), is_before_long=len(block) > AT_ONCE)
            corners = topology.ranges(self._starts[block], self._sizes[block])
            found = self._by_blender(block, corners, before.nodes, method)
            if found is not None:
                uv[corners] = found
        yield Progress("Unwrapping", 1.0)
        return self._better(before, self._measured(before.labels, uv, before.nodes, chosen), chosen)

    def _by_blender(self, faces: np.ndarray, corners: np.ndarray, nodes: np.ndarray, method: str) -> np.ndarray | None:
        """The UVs of the corners of some faces; None if Blender cannot."""
        used, vertices = numbered(nodes[corners])
        points = np.empty((len(used), 3))
        points[vertices] = self._points[corners]
        sizes = self._sizes[faces]
        with temporary.scene() as scene:
            data = bpy.data.meshes.new(temporary.TEMPORARY)
            mesh_writer.fill(data, points, vertices, np.cumsum(sizes) - sizes)
            data.update(calc_edges=True)
            data.uv_layers.active = data.uv_layers.new(name="UVMap")
            obj = temporary.add_object(scene, data)
            try:
                with editing(obj):
                    bpy.ops.uv.unwrap(
                        method=method, fill_holes=False, correct_aspect=False, margin=0.0, **_more(method, len(faces))
                    )
            except RuntimeError:  # an operator that cannot work says so in this way
                return None
            uv = np.empty((len(corners), 2), np.float32)
            data.uv_layers.active.uv.foreach_get("vector", uv.reshape(-1))
        return np.nan_to_num(uv.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)

    def _projected(self, labels: np.ndarray) -> np.ndarray:
        """The UVs (C, 2) by projection along the mean normal of each chart."""
        normals = self.charts.mean_normals(labels)
        along = np.eye(3)[np.abs(normals).argmin(axis=1)]
        u = np.cross(along, normals)
        u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-300)
        axes = np.stack([u, np.cross(normals, u)], axis=1)
        uv = np.zeros((len(self._points), 2))
        corners = topology.ranges(self._starts, self._sizes)
        of = np.repeat(labels, self._sizes)
        uv[corners] = (axes[of] * self._points[corners][:, None]).sum(axis=2)
        return uv

    def _measured(
        self, labels: np.ndarray, uv: np.ndarray, nodes: np.ndarray, chosen: np.ndarray | None = None
    ) -> Flattened:
        """With the stretch and the scale of charts, of the chosen ones (N,) bool; of others, both are as without stretch."""
        islands, triangles = labels[self.mesh.faces], self.mesh.triangles
        stretch, scale = np.zeros(int(labels.max(initial=-1)) + 1), np.ones(int(labels.max(initial=-1)) + 1)
        if chosen is not None and not chosen.all():
            some = chosen[islands]
            islands, triangles = islands[some], triangles[some]
        if len(islands):
            here, islands = numbered(islands)
            needs = uv_stretch.needs(self._points[triangles], uv[triangles], islands)
            bad = needs.is_folded
            bad[islands[uv_crossings.crossing(uv[triangles], nodes[triangles], islands)]] = True
            bad &= np.bincount(labels)[here] > 1
            stretch[here], scale[here] = np.where(bad, np.inf, needs.need - needs.surface), needs.scale
        scaled = np.zeros_like(uv)
        corners = topology.ranges(self._starts, self._sizes)
        scaled[corners] = uv[corners] * scale[np.repeat(labels, self._sizes)][:, None]
        return Flattened(labels, scaled, nodes, stretch)

    def _better(self, one: Flattened, other: Flattened, chosen: np.ndarray) -> Flattened:
        """Those of `one`, and of the chosen charts the ones of `other` that have less stretch."""
        return self._taken(one, other, chosen & (other.stretch < one.stretch))

    def _taken(self, one: Flattened, other: Flattened, chosen: np.ndarray) -> Flattened:
        """Those of `one`, and the chosen charts of `other`."""
        uv = one.uv.copy()
        corners = topology.ranges(self._starts, self._sizes)
        corners = corners[np.repeat(chosen[one.labels], self._sizes)]
        uv[corners] = other.uv[corners]
        return replace(one, uv=uv, stretch=np.where(chosen, other.stretch, one.stretch))


def _more(method: str, faces: int) -> dict[str, int]:
    return {"iterations": max(FEWEST, min(ITERATIONS, MANY // faces))} if method == STRETCH else {}


def _same(labels: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which charts (N,) bool have the same faces as one of the others."""
    count = int(labels.max(initial=-1)) + 1
    other = np.zeros(count, np.int64)
    other[labels] = others
    differs = np.bincount(labels, others != other[labels], count) > 0.0
    return ~differs & (np.bincount(labels, minlength=count) == np.bincount(others)[other])


@contextmanager
def editing(obj: bpy.types.Object) -> Iterator[None]:
    """Edit Mode, with everything selected, for the operators of the UV editor."""
    (scene,) = obj.users_scene
    scene.tool_settings.use_uv_select_sync = True  # so that the selection of faces counts
    layer = scene.view_layers[0]
    with bpy.context.temp_override(
        scene=scene, view_layer=layer, active_object=obj, object=obj, selected_objects=[obj]
    ):
        layer.objects.active = obj
        bpy.ops.object.mode_set(mode="EDIT")
        try:
            with bpy.context.temp_override(edit_object=obj, objects_in_mode_unique_data=[obj]):
                bpy.ops.mesh.reveal(select=True)
                bpy.ops.mesh.select_all(action="SELECT")
                yield
        finally:
            bpy.ops.object.mode_set(mode="OBJECT")
