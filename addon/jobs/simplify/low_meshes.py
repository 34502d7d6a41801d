# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes low meshes of a surface: by Blender's Decimate, or by collapsing the last edges by quadrics; as it is, or of voxels.

No way wins everywhere. At 3,000 triangles, Decimate has a fifth of the error of quadrics on a chess piece with open rims, and
quadrics two thirds of that of Decimate on a bust; so the ways are compared by what a viewer sees.
"""

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import bpy
import numpy as np
from mathutils import Matrix

from ...core.asset_limits import OFF
from ...core.progress import Task, Timings, aside, relay
from ...core.simplify import Candidate, Maker, making
from ...mesh import face_weights, fitting, flips, folds, mirrors, small_parts
from ...mesh.closest import Surface
from ...mesh.collapse import CollapseOptions, PartialCollapse, collapse, partial_collapse
from ...mesh.fitting import FitOptions, Samples, surface_samples
from ...mesh.mirrors import Plane
from ...mesh.triangles import barycentric
from ...mesh.welding import thinned, weld
from ...scene import mesh_reader, mesh_writer
from .. import temporary
from ..temporary import TEMPORARY
from .decimation import decimated

SHARES_FOR_PARTS = 0.5, 0.2, 0.1, 0.05
"""The shares of the triangles of a low mesh that tetrahedra in place of its parts may take: the next one, if the parts took
more."""
VOXELS = 60_000
"""About how many voxels the outer surface has that is remeshed."""
MOST_ALONG = 2000
"""The most voxels along the longest side of the box: along needles, by their area alone, there would be millions."""
FAR, MOST_FAR = 2.0, 0.25
"""Voxels, and a share of what is seen from outside. If more of it is farther from the remeshed surface, the volume is open.
What is farther in a closed volume lies in gaps that the voxels close."""
COMPARED_SAMPLES = 20_000
"""How many samples of the surface are compared with the remeshed one."""
DENSE = 60_000
"""The triangles that Decimate leaves of larger surfaces, for all low meshes that are coarser still: it takes most time."""
THINNED = 3 * DENSE
"""The triangles that a grid leaves of surfaces twice as large before Decimate, which takes half the time then, or less.
Measured with samples of surfaces of 200,000 to 400,000: the low meshes of 5,000 lie 6 % nearer to 2 % farther."""
FINER = 6
"""How many times as many triangles as a low mesh those have at least: until then, hardly anything is lost."""
MOST_SHARED = 0.8
"""The share of the triangles up to which low meshes that differ by their weights alone have a mesh in common on their way."""
FITTED = 10_000, 60_000
"""The fewest and the most samples of the surface to which low meshes are fitted: two a triangle of the surface, or about 20 a
triangle of the low mesh."""
FIT = FitOptions(rounds=2, smooth=0.005, along=0.1)
"""How low meshes are fitted, before edges flip and after that. Tried, from the same 3,000 triangles: samples of a chess piece
lie 5 %, those of a helmet 8 % nearer than with vertices that slide less, as by default."""
COLLAPSE_BIAS = 1.03
"""By which factor collapsing by quadrics must be better than Decimate: quick looks differ by less from the finished asset."""
REMESH_BIAS = 1.1
"""By which factor a surface with bad edges or walls inside must be better than its remeshed one: they may show later."""
POSED_BIAS = 1.0 / 1.25
"""The bias of a low mesh whose edges collapse by poses, too: at rest it may look that much worse."""
MIRRORED_BIAS = 1.0 / 1.02
"""The bias of a low mesh that equals its mirror image, of a surface that does: it may look that much worse."""
SHARP = math.radians(100.0)
"""The angle between faces from which the edge between them is sharp: normals that are shared there point behind faces."""


class Source(Maker, Protocol):
    """A mesh that low ones are made of, and the way, as DecimationSource has it. keeps_planes: whether planes and straight
    edges stay."""

    samples: Samples
    bias: float
    is_remeshed: bool
    left_out: int
    mirror: Plane | None
    keeps_planes: bool

    @property
    def triangles(self) -> int: ...

    @property
    def is_collapsed(self) -> bool: ...


@dataclass(frozen=True, eq=False)
class DecimationSource:
    """A mesh that low ones are made of, and the way.

    Attributes:
        data: Of triangles.
        dense: Of as many of them as the way needs for most low meshes.
        samples: In the triangles of `dense`: low meshes are fitted to them.
        outer_samples: Of all of the surface that sees the outside: they tell what is folded.
        timings: Get the time of what is made, as "decimate".
        is_remeshed: Whether it is made of voxels.
        bias: A factor on what a viewer sees wrong of its low meshes.
        weights: Of the triangles of `dense`, if edges collapse to the best points by them, as mesh/collapse.py does; without
            them, Decimate makes it all.
        begun: Where these collapses go on, so far.
        left_out: How many parts it lacks, since a low mesh has no triangles for them.
        motions: (P, V, 3, 4), of the vertices of `dense`, as CollapseOptions has them.
        mirror: Where `data` was cut in half, so that low meshes equal their mirror images; None if it was not.
    """

    data: bpy.types.Mesh
    dense: bpy.types.Mesh
    samples: Samples
    outer_samples: Samples
    timings: Timings
    is_remeshed: bool = False
    bias: float = 1.0
    weights: np.ndarray | None = None
    begun: list[PartialCollapse] = field(default_factory=list)
    left_out: int = 0
    motions: np.ndarray | None = None
    keeps_planes = False
    mirror: Plane | None = None

    @property
    def triangles(self) -> int:
        return len(self.data.polygons) * (1 if self.mirror is None else 2)

    @property
    def is_collapsed(self) -> bool:
        return self.weights is not None

    def weighted(self) -> "DecimationSource":
        """The same mesh, whose edges collapse by how much it bends."""
        weights = face_weights.by_bending(*arrays(self.dense))
        return replace(self, bias=self.bias * COLLAPSE_BIAS, weights=weights, begun=[])

    def posed(self, motions: np.ndarray) -> "DecimationSource":
        """The same mesh, whose edges collapse by what they are in poses, too.

        motions: (P, V, 3, 4), as the attribute.
        """
        return replace(self, bias=self.bias * POSED_BIAS, motions=motions, begun=[])

    def halved(self, plane: Plane) -> "DecimationSource":
        """The half of the same mesh beyond a plane: its low meshes are joined with their mirror images."""
        data = new_mesh(*mirrors.half(*arrays(self.data), plane))
        dense = data if self.dense == self.data else new_mesh(*mirrors.half(*arrays(self.dense), plane))
        samples, outer_samples = (
            each.chosen(each.points[:, plane.axis] >= plane.place) for each in (self.samples, self.outer_samples)
        )
        points, triangles = arrays(dense)
        nearest, _, _ = Surface(points, triangles).closest(samples.points.astype(np.float32))
        weights, motions, whole = self.weights, self.motions, arrays(self.dense)
        if weights is not None:
            weights = weights[Surface(*whole).closest(points[triangles].mean(axis=1))[0]]
        if motions is not None:
            of, where, _ = Surface(*whole).closest(points)
            shares = barycentric(where.astype(np.float64), whole[0][whole[1][of]].astype(np.float64))
            motions = np.einsum("vc,pvcij->pvij", shares, motions[:, whole[1][of]])
        return replace(
            self,
            data=data,
            dense=dense,
            samples=replace(samples, triangles=nearest),
            outer_samples=outer_samples,
            bias=self.bias * MIRRORED_BIAS,
            weights=weights,
            motions=motions,
            begun=[],
            mirror=plane,
        )

    def make(self, triangles: int) -> Task[list["LowMesh"]]:
        """A low mesh of about this many triangles, without the smallest parts, if all of them took too many."""
        yield making(triangles)
        source, low = self, None
        own = triangles if self.mirror is None else (triangles + 1) // 2
        for share in SHARES_FOR_PARTS:
            fewer = self._of_parts(own, share)
            if low is not None and fewer.left_out == source.left_out:
                continue
            if low is not None:
                low.remove()
            made = relay(fewer._made(own), within=lambda: self.timings.timed("decimate"))
            source, low = fewer, (yield from made)
            if low.triangles <= (1.0 + OFF) * triangles:
                break
        return [low]

    def _made(self, triangles: int) -> Task["LowMesh"]:
        """A low mesh of about this many triangles, or of more if its parts cannot become coarser."""
        data = yield from self._unfolded_low(triangles)
        points, corners, nearest = yield from aside(partial(self._shaped, *arrays(data)), making(triangles))
        bpy.data.meshes.remove(data)
        data = new_mesh(points, corners)
        data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
        data.update()
        data.set_sharp_from_angle(angle=SHARP)
        return LowMesh(data, self, nearest)

    def _shaped(self, points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A coarse mesh, fitted and with edges flipped, and with its mirror image if it is a half: its points, triangles, and
        the triangle of each sample."""
        points, corners, nearest = self._fitted(points, corners)
        corners, nearest = flips.flip(points, corners, self.samples, nearest)
        points, corners, nearest = self._fitted(points, corners, nearest)
        if self.mirror is not None:
            points, corners = mirrors.joined(points, corners, self.mirror)
        return points, corners, nearest

    def _fitted(
        self, points: np.ndarray, corners: np.ndarray, start: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A coarse mesh as fitting.fit moves it: its points, triangles, and the triangle of each sample. A half is moved beside
        its mirror image. start: the triangle of each sample so far."""
        if self.mirror is None:
            points, nearest = fitting.fit(points, corners, self.samples, FIT, start)
            return points, corners, nearest
        whole, faces = mirrors.joined(points, corners, self.mirror)
        count, mirrored = len(corners), self.mirror.both(self.samples)
        start = None if start is None else np.concatenate([start, start + count])
        moved, nearest = fitting.fit(whole, faces, mirrored, FIT, start)
        return moved[: len(points)], faces[:count], nearest[: len(self.samples.points)] % count

    def corrected(self, candidate: Candidate) -> "DecimationSource | None":
        """The same mesh, whose edges collapse by what a viewer saw of a low one that its edges became."""
        appearance, nearest = candidate.deviation.appearance, candidate.mesh.nearest
        if not self.is_collapsed or appearance is None or candidate.mesh.source is not self:
            return None
        sums = np.bincount(nearest, appearance.places * self.samples.shares)
        excess = sums / max(float(sums.mean()), 1e-300)
        _, triangles = arrays(self.dense)
        weights = face_weights.by_error(self.weights, triangles, self.samples.triangles, excess[nearest])
        return replace(self, weights=weights)

    def _of_parts(self, triangles: int, share: float) -> "DecimationSource":
        """The same mesh without the smallest parts, if all of them would take more than a share of so many triangles."""
        points, corners = arrays(self.dense)
        is_kept, left_out = small_parts.largest(points, corners, triangles, share)
        if not left_out or triangles >= len(corners):
            return self
        dense, number = new_mesh(points, corners[is_kept]), np.cumsum(is_kept) - 1
        samples = self.samples.chosen(is_kept[self.samples.triangles])
        return replace(
            self,
            data=dense,
            dense=dense,
            samples=replace(samples, triangles=number[samples.triangles]),
            weights=None if self.weights is None else self.weights[is_kept],
            begun=[],
            left_out=self.left_out + left_out,
        )

    def _unfolded_low(self, triangles: int) -> Task[bpy.types.Mesh]:
        """A mesh of about this many triangles, without folds."""
        data, folded = self._unfolded((yield from self._coarse(triangles)))
        if not folded or len(data.polygons) > (1.0 - OFF / 2.0) * triangles:
            return data
        bpy.data.meshes.remove(data)
        return self._unfolded((yield from self._coarse(triangles + folded)))[0]

    def _unfolded(self, data: bpy.types.Mesh) -> tuple[bpy.types.Mesh, int]:
        """A mesh without the folds of `data`, which is `data` itself or replaces it, and the triangles that it lost."""
        points, corners = arrays(data)
        points, unfolded = folds.unfold(points, corners, self.outer_samples)
        if unfolded is corners:
            return data, 0
        bpy.data.meshes.remove(data)
        return new_mesh(points, unfolded), len(corners) - len(unfolded)

    def _coarse(self, triangles: int) -> Task[bpy.types.Mesh]:
        """A mesh of about this many triangles. What has no more than a tetrahedron stays as it is."""
        if len(self.data.polygons) <= small_parts.LEAST:
            return self.data.copy()
        is_enough = FINER * triangles <= len(self.dense.polygons) or self.dense == self.data
        if not self.is_collapsed or not is_enough:
            return decimated(self.dense if is_enough else self.data, triangles)
        collapsing = partial(self._collapsed, *arrays(self.dense), triangles)
        coarse = new_mesh(*(yield from aside(collapsing, making(triangles))))
        if len(coarse.polygons) <= triangles:
            return coarse
        try:  # its borders are in the way
            return decimated(coarse, triangles)
        finally:
            bpy.data.meshes.remove(coarse)

    def _collapsed(self, points: np.ndarray, corners: np.ndarray, triangles: int) -> tuple[np.ndarray, np.ndarray]:
        """The points and triangles of the dense mesh, which has these, with its edges collapsed to this many triangles."""
        options, least = CollapseOptions(triangles, self.weights, motions=self.motions), FINER * triangles
        if least >= MOST_SHARED * len(corners):
            return collapse(points, corners, options)
        usable = [each for each in self.begun if len(each.triangles) >= least]
        if not usable:
            usable = [partial_collapse(points, corners, replace(options, triangles=least))]
            self.begun.extend(usable)
        start = min(usable, key=lambda each: len(each.triangles))
        return collapse(points, corners, replace(options, start=start))


@dataclass(frozen=True, eq=False)
class LowMesh:
    """A low mesh.

    Attributes:
        data: The mesh, relative to the origin of the high surface.
        source: What it is made of.
        nearest: (N,) int, its triangle at each sample of the source.
        is_folded: Whether triangles are turned over that its source cannot turn back.
    """

    data: bpy.types.Mesh
    source: Source
    nearest: np.ndarray
    is_folded: bool = False

    @property
    def triangles(self) -> int:
        return mesh_reader.count_triangles(self.data)

    def remove(self) -> None:
        bpy.data.meshes.remove(self.data)


def sources_of(
    data: bpy.types.Mesh,
    outer_samples: Samples,
    timings: Timings,
    *,
    bias: float = 1.0,
    is_remeshed: bool = False,
) -> list[DecimationSource]:
    """A mesh as a source for Decimate, and for collapsing edges."""
    dense = _dense(data)
    if dense is data and not is_remeshed:
        points, triangles = arrays(data)
        count = int(np.clip(2 * len(triangles), *FITTED))
        samples = surface_samples(points, triangles, count, face_weights.by_bending(points, triangles) ** 2)
    else:
        samples = outer_samples.spread(FITTED[1])
        nearest, _, _ = Surface(*arrays(dense)).closest(samples.points.astype(np.float32))
        samples = replace(samples, triangles=nearest)
    plain = DecimationSource(data, dense, samples, outer_samples, timings, is_remeshed, bias)
    return [plain, plain.weighted()]


def _dense(data: bpy.types.Mesh) -> bpy.types.Mesh:
    """A mesh of at most about DENSE triangles: `data` itself if it is one."""
    if len(data.polygons) <= DENSE:
        return data
    if len(data.polygons) < 2 * THINNED:
        return decimated(data, DENSE)
    thin = new_mesh(*weld(*thinned(*arrays(data), THINNED)))
    try:
        return decimated(thin, DENSE)
    finally:
        bpy.data.meshes.remove(thin)


def remeshed(data: bpy.types.Mesh, area: float, outer_samples: Samples) -> bpy.types.Mesh | None:
    """The surface of the volume that the triangles enclose, of voxels; None if they enclose none.

    area: of what is seen from outside, at these samples.
    """
    longest = float(np.ptp(mesh_reader.points(data), axis=0).max())
    voxel = max(math.sqrt(area / VOXELS), longest / MOST_ALONG)
    with temporary.scene() as scene:
        obj = temporary.add_object(scene, data.copy())
        obj.data.transform(Matrix.Scale(1.0 / voxel, 4))  # Blender takes no voxels smaller than 0.0001
        remesh = obj.modifiers.new(TEMPORARY, "REMESH")
        remesh.mode, remesh.voxel_size = "VOXEL", 1.0
        obj.modifiers.new(TEMPORARY, "TRIANGULATE")
        result = temporary.evaluated(scene, obj)
    if not result.polygons:
        return None
    result.transform(Matrix.Scale(voxel, 4))
    corners = mesh_reader.corner_vertices(result).reshape(-1, 3)
    samples = outer_samples.spread(COMPARED_SAMPLES).points.astype(np.float32)
    _, _, squares = Surface(mesh_reader.points(result), corners).closest(samples)
    return result if np.mean(squares > (FAR * voxel) ** 2) < MOST_FAR else None


def arrays(data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The points (V, 3) float32 and the triangles (T, 3) int of a mesh of triangles."""
    return mesh_reader.points(data), mesh_reader.corner_vertices(data).reshape(-1, 3)


def new_mesh(points: np.ndarray, triangles: np.ndarray) -> bpy.types.Mesh:
    """A mesh of triangles (T, 3) int, of points (V, 3)."""
    data = bpy.data.meshes.new(TEMPORARY)
    mesh_writer.fill(data, points, triangles)
    data.update(calc_edges=True)
    return data
