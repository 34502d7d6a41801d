# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes levels of detail that show the textures of a low mesh: coarser meshes with its UV layout.

Their vertices move onto the high surface, and along it to where the low mesh has their UVs. Their normals are as near as can
be to those of the low mesh, from which a normal map in tangent space counts, or what they show with that map is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import bpy
import numpy as np

from ...core import foreach
from ...core.progress import Progress, Task, aside
from ...core.simplify import making
from ...mesh import fitting, topology
from ...mesh.carried_normals import (
    INNER,
    Framed,
    LaidOut,
    carried_normals,
    common_normals,
    fitted_normals,
    found_on,
)
from ...mesh.collapse import CollapseOptions
from ...mesh.fitting import FitOptions, Samples
from ...mesh.layout_collapse import Charted, collapse_layout
from ...mesh.layout_flips import Shown, flipped
from ...mesh.layout_halves import Halves
from ...mesh.open_borders import Border
from ...mesh.triangles import face_areas, transformed, unit, unit_normals
from ...scene import mesh_reader, mesh_writer
from ..temporary import TEMPORARY
from .decimation import UvMesh

CUSTOM = "custom_normal"
"""The attribute of custom normals."""
FARTHEST_COSINE = 0.2
"""The least cosine between a face of the low mesh and a normal that it shares with levels."""
APART = 2.0
"""How far islands lie apart where places in the layout are looked for: those that share texels are other ones."""
FITTED = 30_000
"""The samples of the high surface to which a level is fitted."""
WITHIN = 1e-5
"""How far a place of the layout may be off a level to lie on it."""
SHOWN = 0.96
"""The share of the low mesh that a level must show for its vertices to slide to where the layout has them: where more of it is
gone, outlines suffer from it.
Tried on a chess piece and a helmet of 3,000 triangles, at 1,500, 750 and 375, with maps in object space: 1.77, 3.47 and 7.65
degrees become 1.52, 3.03 and 6.48 where 99.8, 98 and 95 % are shown, 6.75, 13.0 and 22.0 become 6.44, 12.3 and 22.1 where 97,
85 and 57 % are; outlines of 0.78, 1.59, 3.74, 1.34, 2.62 and 4.68 % become 0.77, 1.64, 4.23, 1.43, 2.94 and 6.49 %."""


@dataclass(frozen=True, eq=False)
class SharedLevel(UvMesh):
    """A level with the UV layout of a low mesh.

    Attributes:
        charted: As arrays.
    """

    charted: Charted


@dataclass(frozen=True, eq=False)
class LayoutSource:
    """A low mesh that coarser ones with its UV layout are made of.

    Attributes:
        mesh: The low mesh, with its corner normals.
        samples: Of the high surface, in world space.
        room: How far borders of islands may move outwards, as a share of the map's side.
        motions: (P, V, 3, 4), to where poses move its vertices in its own space, as CollapseOptions has them; None for none.
    """

    mesh: UvMesh
    samples: Samples
    room: float
    motions: np.ndarray | None = None

    @property
    def triangles(self) -> int:
        return len(self._charted.triangles)

    def in_world(self, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Its vertices (V, 3) in world space, relative to an origin, and triangles (T, 3)."""
        points, triangles = self._surface
        return transformed(points, self.mesh.to_world) - origin, triangles

    def posed(self, motions: np.ndarray | None, origin: np.ndarray) -> "LayoutSource":
        """The same, whose levels are near it in poses, too. motions: (P, V, 3, 4), of `in_world`; None for none."""
        if motions is None:
            return self
        to_place = self.mesh.to_world.copy()
        to_place[:3, 3] -= origin
        whole = np.broadcast_to(np.eye(4), (*motions.shape[:2], 4, 4)).copy()
        whole[..., :3, :] = motions
        return replace(self, motions=(np.linalg.inv(to_place) @ whole @ to_place)[..., :3, :])

    def make(self, triangles: int) -> Task[list["SharedLevel"]]:
        """A mesh of about this many triangles."""
        yield making(triangles)
        _ = self._layer, self._charted, self._normals  # which read Blender's mesh: not on another thread
        coarse, normals = yield from aside(partial(self._shaped, triangles), making(triangles))
        data = self._written(coarse, normals)
        return [SharedLevel(data, self.mesh.layer, self.mesh.name, self.mesh.to_world, coarse)]

    def _shaped(self, triangles: int) -> tuple[Charted, np.ndarray]:
        """A coarser mesh of about this many triangles, fitted to the high surface, and its normals (N, 3, 3)."""
        halves, motions = self._halves, self.motions
        if halves is not None:
            triangles, motions = triangles // 2, halves.motions(motions)
        coarse = collapse_layout(self._shaping, CollapseOptions(triangles, motions=motions), self.room)
        options = FitOptions(free=coarse.free, border=self._border)
        points, _ = fitting.fit(coarse.points, coarse.triangles, self._samples, options)
        coarse = self._settled(replace(coarse, points=points))
        if halves is not None:
            coarse = halves.joined(coarse)
        return coarse, self._even(self.carried_to(coarse, self._normals))

    def _even(self, normals: np.ndarray, *, is_level: bool = True) -> np.ndarray:
        """Normals (T, 3, 3) of a level, or of the low mesh, that are their own mirror image if the mesh is."""
        return normals if self._halves is None else self._halves.even(normals, is_joined=is_level)

    @property
    def bend(self) -> float:
        """The mean angle in degrees between the normals of corners and their faces, by area."""
        points, triangles = self._surface
        faces, areas = unit_normals(points[triangles])
        cosines = (self._normals * faces[:, None]).sum(axis=2)
        return float(np.average(np.degrees(np.arccos(cosines.clip(-1.0, 1.0))).mean(axis=1), weights=areas))

    def common_normals(self, levels: Sequence["SharedLevel"]) -> Task[list[np.ndarray]]:
        """Normals (T, 3, 3) at corners of the low mesh and of its levels, that differ as little as can be in the same places of
        the layout. Those of the low mesh are not far from its faces."""
        points, triangles = self._surface
        everything = np.arange(len(triangles))
        own = LaidOut(
            self._in_layout(self._charted, everything), points[triangles], self._charted.wedges, self._normals
        )
        others = [
            LaidOut(
                self._in_layout(each.charted, each.charted.faces),
                each.charted.points[each.charted.triangles],
                each.charted.wedges,
                mesh_reader.corner_normals(each.data).reshape(-1, 3, 3).astype(np.float64),
            )
            for each in levels
        ]
        step = Progress("Choosing normals", 0.0)
        found, *of_levels = yield from aside(partial(common_normals, [own, *others]), step)
        found = self._even(found, is_level=False)
        faces = unit_normals(points[triangles])[0][:, None]
        is_near = (found * faces).sum(axis=2, keepdims=True) > FARTHEST_COSINE
        return [np.where(is_near, found, self._normals), *map(self._even, of_levels)]

    def fit_normals(self, data: bpy.types.Mesh, level: "SharedLevel", texels: np.ndarray) -> None:
        """Give a level the normals with which it shows most of what the low mesh, whose `data` has its normals, shows with a
        map.

        texels: (rows, columns, 3), as Framed.shown takes them.
        """
        fine, own = self._framed(data), self._framed(level.data)
        if len(own.corners) == len(level.charted.triangles):  # none is left out for its values
            set_normals(level.data, self._even(fitted_normals(fine, own, level.charted.wedges, texels)))

    def _framed(self, data: bpy.types.Mesh) -> Framed:
        mesh = mesh_reader.with_tangents(data, self.mesh.layer, self.mesh.name, self.mesh.to_world)
        corners, at = mesh.positions[mesh.vertices[mesh.triangles]], mesh.triangles
        values = corners, mesh.normals[at], mesh.tangents[at], mesh.uv[at]
        return Framed(*(each.astype(np.float64) for each in values))

    def carried_to(self, coarse: Charted, normals: np.ndarray) -> np.ndarray:
        """The normals (N, 3, 3) of a level, as near as they can be to those (T, 3, 3) of the low mesh."""
        fine = self._in_layout(self._charted, np.arange(len(self._charted.triangles))), normals
        places = self._in_layout(coarse, coarse.faces)
        return carried_normals(fine, places, coarse.points[coarse.triangles], coarse.wedges)

    def _in_layout(self, mesh: Charted, faces: np.ndarray) -> np.ndarray:
        """The corners (N, 3, 3) of a mesh in the layout, each island on a plane of its own.

        faces: (N,) int, the triangles of the low mesh that its triangles were.
        """
        number = self._layer
        heights = np.broadcast_to(APART * self._islands[faces][:, None, None], (len(faces), 3, 1))
        return np.concatenate([mesh.values[..., 2 * number : 2 * number + 2], heights], axis=2)

    @cached_property
    def _layer(self) -> int:
        """The number of the UV layer of its map."""
        return list(self.mesh.data.uv_layers.keys()).index(self.mesh.layer)

    @cached_property
    def _islands(self) -> np.ndarray:
        wedges = self._charted.wedges
        return topology.components(tuple(wedges.T), int(wedges.max(initial=-1)) + 1)[0]

    def give(self, data: bpy.types.Mesh, normals: np.ndarray) -> None:
        """Give the mesh itself, which has its corners, other normals (T, 3, 3)."""
        surface = self.mesh.surface
        every = surface.normals.copy()
        every[surface.triangles[self._kept]] = normals
        set_normals(data, every)

    def corrected(self, _candidate: object) -> None:
        """It spares nothing."""

    @cached_property
    def _kept(self) -> np.ndarray:
        """The numbers of the triangles that have an area."""
        surface = self.mesh.surface
        return np.flatnonzero(face_areas(surface.positions, surface.vertices[surface.triangles]) > 0.0)

    @cached_property
    def _charted(self) -> Charted:
        surface, data = self.mesh.surface, self.mesh.data
        corners = surface.triangles[self._kept]
        values = np.concatenate([mesh_reader.uvs(data, layer.name)[corners] for layer in data.uv_layers], axis=2)
        slots = foreach.read(data.polygons, "material_index")[surface.faces[self._kept]]
        points = surface.positions.astype(np.float64)
        return Charted(points, surface.vertices[corners], values.astype(np.float64), slots, len(data.uv_layers))

    @cached_property
    def _halves(self) -> Halves | None:
        """Those of the low mesh, if it equals its mirror image: so do its levels."""
        return Halves.of(self._charted)

    @property
    def _shaping(self) -> Charted:
        """What levels are collapsed from: the low mesh, or a half of it."""
        return self._charted if self._halves is None else self._halves.half

    @cached_property
    def _normals(self) -> np.ndarray:
        return unit(self.mesh.surface.normals[self.mesh.surface.triangles[self._kept]].astype(np.float64))

    @property
    def _surface(self) -> tuple[np.ndarray, np.ndarray]:
        return self._charted.points, self._charted.triangles

    @cached_property
    def _border(self) -> Border | None:
        """Of the low mesh, in its space: the high one can have borders of parts that were left out. On the side of its half if
        it has one."""
        border, halves = Border.of(*self._surface), self._halves
        if border is None or halves is None:
            return border
        return border.chosen(border.points[:, halves.plane.axis] >= halves.plane.place)

    @cached_property
    def _samples(self) -> Samples:
        """In the space of the low mesh; on the side of its half if it has one."""
        to_local, halves = np.linalg.inv(self.mesh.to_world), self._halves
        some = self.samples.spread(FITTED if halves is None else FITTED // 2)
        points = some.points @ to_local[:3, :3].T + to_local[:3, 3]
        some = replace(some, points=points, normals=unit(some.normals @ self.mesh.to_world[:3, :3]))
        return some if halves is None else halves.plane.folded(some)

    def _settled(self, coarse: Charted) -> Charted:
        """A coarser mesh with its edges turned, and its vertices along the surface, to where the low mesh has them in the
        layout: texels show their own place."""
        fine = self._shaping
        points, triangles = fine.points, fine.triangles
        faces = np.arange(len(triangles)) if fine.faces is None else fine.faces
        which, shares = np.repeat(np.arange(len(triangles)), len(INNER)), np.tile(INNER, (len(triangles), 1))
        in_layout = self._in_layout(fine, faces)
        on_them = np.einsum("nc,ncx->nx", shares, in_layout[which])
        found, there, squares = found_on(self._in_layout(coarse, coarse.faces), on_them)
        areas, is_shown = face_areas(points, triangles)[which], squares <= WITHIN**2
        normals = unit(np.einsum("nc,ncx->nx", shares, self._normals[faces[which]]))
        places = Samples(np.einsum("nc,ncx->nx", shares, points[triangles[which]]), normals, which, areas).chosen(
            is_shown
        )
        shown = Shown(on_them[is_shown, :2], places.points, places.shares, found[is_shown], there[is_shown])
        coarse, shown = flipped(coarse, shown, self._layer)
        if places.shares.sum() < SHOWN * areas.sum():
            return coarse
        on_it = shown.triangles, shown.shares
        options = FitOptions(free=coarse.free, border=self._border)
        return replace(coarse, points=fitting.slid(coarse.points, coarse.triangles, on_it, places, options))

    def _written(self, coarse: Charted, normals: np.ndarray) -> bpy.types.Mesh:
        """A mesh with the names of UV layers of the low one, and its numbers of materials, which it gets after the bake."""
        data, source = bpy.data.meshes.new(TEMPORARY), self.mesh.data
        mesh_writer.fill(data, coarse.points, coarse.triangles)
        data.update(calc_edges=True)
        data.polygons.foreach_set("use_smooth", np.ones(len(coarse.triangles), bool))
        data.polygons.foreach_set("material_index", coarse.labels.astype(np.int32))
        for number, layer in enumerate(source.uv_layers):
            made = data.uv_layers.new(name=layer.name)
            uv = coarse.values[..., 2 * number : 2 * number + 2].astype(np.float32)
            made.uv.foreach_set("vector", np.ascontiguousarray(uv).reshape(-1))
        data.uv_layers.active = data.uv_layers[self.mesh.layer]
        for layer in source.uv_layers:
            data.uv_layers[layer.name].active_render = layer.active_render
        set_normals(data, normals)
        return data


def custom_normals(data: bpy.types.Mesh) -> np.ndarray | None:
    """The custom normals (C, 3) of a mesh at its corners; None if it has none."""
    return mesh_reader.corner_normals(data) if CUSTOM in data.attributes else None


def set_normals(data: bpy.types.Mesh, normals: np.ndarray | None) -> None:
    """Give a mesh custom normals at its corners, in order: any shape of three floats each. None takes them away."""
    if CUSTOM in data.attributes:
        data.attributes.remove(data.attributes[CUSTOM])
    if normals is None:
        data.update()
        return
    custom = data.attributes.new(CUSTOM, "FLOAT_VECTOR", "CORNER")
    custom.data.foreach_set("vector", np.ascontiguousarray(normals, np.float32).reshape(-1))
    data.update()
