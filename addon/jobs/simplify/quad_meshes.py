# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes low meshes of quads, for those who edit them: by Blender's QuadriFlow, or by joining triangles where that fails."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from ...core.asset_limits import OFF
from ...core.progress import Task, Timings, aside, relay
from ...core.simplify import Candidate, making
from ...mesh import fitting
from ...mesh.fitting import Samples
from ...scene import mesh_reader
from ...scene.mesh_reader import count_triangles
from .. import temporary
from .low_meshes import SHARP, DecimationSource, LowMesh, Source

JOINED_BIAS = 3.0
"""By which factor joined triangles must be better than QuadriFlow: their edges flow nowhere."""
TRIES = 6
"""How often QuadriFlow is asked for another number of faces, until it gives the wanted one."""
MOST_BENT, MOST_SKEWED = math.radians(40.0), math.radians(60.0)
"""The angle between triangles, and that by which corners differ from right ones, up to which two triangles become a quad."""


@dataclass(frozen=True, eq=False)
class QuadSource:
    """A mesh that low ones of quads are made of.

    Attributes:
        base: The mesh as a source of triangles.
    """

    base: DecimationSource
    is_collapsed = False
    left_out = 0
    mirror = None
    keeps_planes = False
    is_joined = False

    @property
    def bias(self) -> float:
        return self.base.bias * (JOINED_BIAS if self.is_joined else 1.0)

    @property
    def samples(self) -> Samples:
        return self.base.samples

    @property
    def timings(self) -> Timings:
        return self.base.timings

    @property
    def is_remeshed(self) -> bool:
        return self.base.is_remeshed

    @property
    def triangles(self) -> int:
        return self.base.triangles

    def make(self, triangles: int) -> Task[list[LowMesh]]:
        """A low mesh of about this many triangles, two a quad; joined ones, if QuadriFlow does not take the mesh."""
        yield making(triangles)
        with self.timings.timed("decimate"):
            data = self._remeshed(triangles)
        if data is None:
            return (yield from JoinedSource(self.base).make(triangles))
        fitted = aside(
            partial(fitting.fit, mesh_reader.points(data), _triangles(data), self.samples), making(triangles)
        )
        points, nearest = yield from relay(fitted, within=lambda: self.timings.timed("decimate"))
        data.vertices.foreach_set("co", points.astype(np.float32).reshape(-1))
        data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
        data.update()
        data.set_sharp_from_angle(angle=SHARP)
        return [LowMesh(data, self, nearest)]

    def _remeshed(self, triangles: int) -> bpy.types.Mesh | None:
        """The mesh whose number of triangles is nearest to this one; None if QuadriFlow does not take it."""
        best, wanted = None, triangles / 2
        for _ in range(TRIES):
            data = quad_remeshed(self.base.dense, max(round(wanted), 1))
            if data is None:
                break
            wanted *= triangles / count_triangles(data)
            pair = sorted([data, *([best] if best else [])], key=lambda each: abs(count_triangles(each) - triangles))
            best = pair[0]
            for worse in pair[1:]:
                bpy.data.meshes.remove(worse)
            if abs(count_triangles(best) - triangles) <= OFF / 2.0 * triangles:
                break
        return best

    def corrected(self, _: Candidate) -> "QuadSource | None":
        """None: QuadriFlow takes no weights."""
        return None


@dataclass(frozen=True, eq=False)
class JoinedSource(QuadSource):
    """A mesh of whose low ones triangles are joined to quads."""

    is_joined = True

    def make(self, triangles: int) -> Task[list[LowMesh]]:
        """A low mesh of about this many triangles."""
        (low,) = yield from self.base.make(triangles)
        joined(low.data)
        return [replace(low, source=self)]


def sources_of(sources: Sequence[Source]) -> list[QuadSource]:
    """The sources of quads in place of those of triangles."""
    base = next(each for each in sources if isinstance(each, DecimationSource))
    return [QuadSource(base), JoinedSource(base)]


def quad_remeshed(data: bpy.types.Mesh, faces: int) -> bpy.types.Mesh | None:
    """A mesh of about this many quads by QuadriFlow; None if it does not take the mesh, whose edges may have too many faces."""
    size = max(float(np.ptp(mesh_reader.points(data), axis=0).max(initial=0.0)), 1e-30)
    with temporary.scene() as scene:
        obj, layer = temporary.add_object(scene, data.copy()), scene.view_layers[0]
        obj.data.transform(Matrix.Scale(1.0 / size, 4))
        layer.update()
        chosen = {"object": obj, "active_object": obj, "selected_objects": [obj], "selected_editable_objects": [obj]}
        try:
            with bpy.context.temp_override(scene=scene, view_layer=layer, **chosen):
                done = bpy.ops.object.quadriflow_remesh(
                    mode="FACES", target_faces=faces, use_mesh_symmetry=False, use_preserve_boundary=True, seed=0
                )
        except RuntimeError:  # what Blender says of meshes that are not manifold
            return None
        if "FINISHED" not in done or not obj.data.polygons:
            return None
        result = temporary.evaluated(scene, obj)
    result.transform(Matrix.Scale(size, 4))
    return result


def joined(data: bpy.types.Mesh) -> None:
    """Join pairs of triangles to quads, as far as they are nearly flat and nearly square."""
    mesh = bmesh.new()
    try:
        mesh.from_mesh(data)
        bmesh.ops.join_triangles(
            mesh,
            faces=mesh.faces,
            cmp_sharp=True,
            angle_face_threshold=MOST_BENT,
            angle_shape_threshold=MOST_SKEWED,
        )
        mesh.to_mesh(data)
    finally:
        mesh.free()
    data.update()


def _triangles(data: bpy.types.Mesh) -> np.ndarray:
    """The triangles (T, 3) int of a mesh of any faces."""
    data.calc_loop_triangles()
    triangles = np.empty(3 * len(data.loop_triangles), np.int32)
    data.loop_triangles.foreach_get("vertices", triangles)
    return triangles.reshape(-1, 3).astype(np.int64)
