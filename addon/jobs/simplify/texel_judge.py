# SPDX-License-Identifier: GPL-3.0-or-later
"""Judges levels of detail: how much a level with its map differs from the original, exactly, and quickly for a search."""

from dataclasses import dataclass, field

import bpy
import gpu
import numpy as np

from ...core import udim
from ...core.declarations.choices import Directions, Hit, Method, Space
from ...core.errors import BakeError
from ...core.map_types import NORMAL
from ...core.progress import Pace, Progress, Task, Timings, part
from ...core.settings import Run, Settings
from ...core.simplify import Limit
from ...engine import baking, normal_space, separation, tree_cache
from ...engine.bands import Band
from ...engine.high_meshes import HighBatches
from ...engine.method_choice import Choice
from ...engine.planning import Plan
from ...mesh import triangle_mesh
from ...mesh.inputs import Meshes
from ...mesh.triangle_mesh import Mesh
from ...mesh.triangles import angles_between, unit
from ...passes import cast, data_texture, lit, mesh_upload, target, viewport
from ...scene import mesh_reader
from .decimation import UvMesh

SIDE = 512
"""The most texels a side of the map that is measured. It is not filtered, so that a larger one would show the same."""
QUICK_SIDE = 320
"""The same of a quick measurement. With fewer, a search takes longer: it goes back more often, after exact measurements."""
PERCENTILE = 99
"""Of the texels, by which levels are judged."""
FLAT, TREES = 0.2, 0.4
"""Which shares of a measurement are done after drawing the map, and after building the trees for rays."""
OFFSETS = (-0.375, -0.125), (0.375, 0.125), (0.125, -0.375), (-0.125, 0.375)
"""Where quick measurements look, in texels from their centers, one after the other: a search keeps triangles that were found
beyond the limit, and would only see that these are right if it looked at the same points again."""
MISSED = 180.0
"""The degrees of a texel whose ray meets no original surface."""
ROOM, FAR = 0.03, 0.25
"""The least and the largest share of the longest side that rays of a quick measurement go outside and inside a level."""


@dataclass(frozen=True)
class Deviations:
    """How a level with its map differs from the original surface, on the texels of its map.

    Attributes:
        degrees: Between the normals that the level shows with its map and those of the original surface where a ray from the
            level meets it, at the 99th percentile.
        bare_degrees: Without the map.
        distance: Along those rays, at the 99th percentile, as a share of the longest side of the original's box.
        by_texel (height, width) float32: The degrees on each texel, 0 on those that are not covered.
    """

    degrees: float
    bare_degrees: float
    distance: float
    by_texel: np.ndarray = field(repr=False, compare=False)

    def excess(self, limit: Limit) -> float:
        """As simplify.Deviation.excess."""
        return limit.excess(self.degrees, self.distance)

    def spent(self, limit: Limit) -> float:
        """As simplify.Deviation.spent."""
        return float((self.by_texel > limit.degrees).mean())


def settings_for(settings: Settings) -> Settings:
    """Settings for the normal map alone, by Flatten, on a single tile of at most SIDE texels a side, with one sample."""
    small = settings.without_file().without_other_maps().of_at_most(SIDE).sampled(samples=1, margin=0)
    return small.traced(
        method=Method.FLATTEN,
        hit=Hit.OWN,
        directions=Directions.BLENDED,
        extrusion=None,
        max_distance=None,
        facing_only=False,
    )


def measure(
    original: Mesh, level: bpy.types.Mesh, layer: str, settings: Settings, pace: Pace
) -> Task[Deviations | None]:
    """Measure a level. Returns None if it covers no texel.

    original: with UVs. level: in the original's space. settings: from settings_for.
    """
    low = mesh_reader.surface(level, layer, original.name, original.to_world, with_faces=True)
    is_tangent = settings.map.space == Space.TANGENT
    basis = mesh_reader.with_tangents(level, layer, original.name, original.to_world) if is_tangent else None
    if basis is not None:
        basis = triangle_mesh.with_stretch(basis, settings.map.basis)
    meshes = Meshes(low, [original], basis, mesh_reader.smooth_normals(level, low), None, layer, False, [])
    normal_map = yield from part(_flattened(meshes, settings, pace), 0.0, FLAT)
    casting = settings.traced(method=Method.CAST)
    plan = Plan(meshes, (udim.FIRST,), Choice(Method.CAST))
    source = (yield from part(baking.draw(plan, Run(casting, pace)), FLAT, TREES)).source
    size = settings.sampling.width, settings.sampling.height
    for _, rows in source.normals(Band(0, size[1], size, 0)):
        yield Progress("Measuring", TREES + (1.0 - TREES) * rows.stop / size[1])
    measured = _compared(basis or low, normal_map, source.drawn().texture, settings)
    is_covered = measured[..., 3] != 0.0
    if not is_covered.any():
        return None
    measured[measured[..., 3] < 0.0, :2] = MISSED
    measured[~is_covered, :2] = 0.0
    degrees, bare = np.percentile(measured[is_covered][:, :2], PERCENTILE, axis=0)
    probe = separation.full_probe(meshes, source.ray_cast)
    vectors = separation.sample(probe, size, [udim.FIRST])
    distances = np.linalg.norm(vectors[vectors[..., 3] > 0.0][:, :3].astype(np.float64), axis=1)
    distance = float(np.percentile(distances, PERCENTILE)) if len(distances) else np.inf
    return Deviations(float(degrees), float(bare), distance / longest_side(original), measured[..., 0].copy())


def longest_side(mesh: Mesh) -> float:
    """The longest side of the box around the mesh in its own space, in scene units."""
    sides = (mesh.box[1] - mesh.box[0]) * np.linalg.norm(mesh.to_world[:3, :3], axis=0)
    return float(sides.max())


def _flattened(meshes: Meshes, settings: Settings, pace: Pace) -> Task[gpu.types.GPUTexture]:
    """The normal map of the level as it is stored, but not yet rounded."""
    plan = Plan(meshes, (udim.FIRST,), Choice(Method.FLATTEN))
    drawing = yield from part(baking.draw(plan, Run(settings, pace)), 0.0, 0.5)
    maps = yield from part(drawing.texels(udim.FIRST), 0.5, 1.0)
    return data_texture.image(maps[NORMAL.name][0])


def _compared(
    basis: Mesh, normal_map: gpu.types.GPUTexture, truth: gpu.types.GPUTexture, settings: Settings
) -> np.ndarray:
    """What viewport.measure_deviation writes, (height, width, 4) float32. basis: the level, with tangents for tangent space."""
    read = (255 if settings.storing.depth == 8 else 0, *normal_space.reading(settings.map)[1:])
    reading = lit.shading(basis.normal_matrix, read=read)
    level = mesh_upload.upload(basis.triangles, **basis.tangent_space)
    measured = target.get("deviation", settings.sampling.width, settings.sampling.height, "RGBA32F")
    nowhere = np.zeros((1, 1), bool)
    viewport.measure_deviation(measured, level, normal_map, truth, reading, elsewhere=nowhere, stretch=basis.stretch)
    values = np.empty((settings.sampling.height, settings.sampling.width, 4), np.float32)
    measured.read(values)
    return values


class TexelJudge:
    """Measures levels of one original, exactly, or about ten times as fast: on fewer texels, in object space, and with one
    drawing of the map for all levels, since Flatten draws the same normals for each of them.

    size: of the map of quick measurements, in texels. settings: of the bakes.
    """

    def __init__(self, original: UvMesh, settings: Settings, pace: Pace):
        self._original, self._settings, self._pace = original, settings_for(settings), pace
        self.size = self._settings.of_at_most(QUICK_SIDE).sampling.size
        self._normals: list[np.ndarray] = []
        self._count = 0

    def prepare(self) -> Task[None]:
        """Build the tree of the original, and draw its map."""
        yield Progress("Building the tree", 0.0)
        timings, original = Timings(), self._original.surface
        tree_cache.trees.ray_scene_of([original], timings)
        drawn = target.Target(*self.size, ("RGBA32F",))
        batches = HighBatches([original], original.to_world, timings)
        for offset in OFFSETS:
            for done in batches.draw(drawn, self._band(offset)):
                yield Progress("Drawing the map", done)
            normals = drawn.texels()[..., :3]
            if self._settings.storing.depth == 8:
                normals = np.round((0.5 * normals + 0.5) * 255.0) / 127.5 - 1.0
            self._normals.append(unit(normals))

    def _band(self, offset: tuple[float, float]) -> Band:
        return Band(0, self.size[1], self.size, 0, offset=offset)

    def exactly(self, level: UvMesh) -> Task[Deviations]:
        """As `measure`. Raises BakeError for a level on no texel."""
        deviations = yield from measure(self._original.surface, level.data, level.layer, self._settings, self._pace)
        return self._on_the_map(deviations)

    def of_original(self) -> Task[Deviations]:
        """Those of the original with its own map, quickly. Raises BakeError if it has no texel on the map."""
        deviations = yield from self.quickly(0.0, self._original)
        return self._on_the_map(deviations if np.isfinite(deviations.degrees) else None)

    def _on_the_map(self, deviations: Deviations | None) -> Deviations:
        if deviations is None:
            raise BakeError(
                f"No triangle of {self._original.name!r} lies on the map: its UVs are outside 0 to 1, or empty."
            )
        return deviations

    def quickly(self, farthest: float, level: UvMesh) -> Task[Deviations]:
        """As `measure`, without the angles of a level without its map; infinite for a level on no texel.

        farthest: how far from the original a level may be, as a share of its longest side.
        """
        yield Progress("Measuring", 0.0)
        original, low, size = self._original.surface, level.surface, self.size
        meshes = Meshes(low, [original], None, mesh_reader.smooth_normals(level.data, low), None, "", False, [])
        reach = (max(ROOM, 1.5 * farthest) if farthest < FAR else FAR) * longest_side(original)
        settings = self._settings.of_at_most(QUICK_SIDE).traced(
            method=Method.CAST, extrusion=reach, max_distance=2.0 * reach
        )
        plan = Plan(meshes, (udim.FIRST,), Choice(Method.CAST), has_clearances=False)
        ray_cast = (yield from baking.draw(plan, Run(settings, self._pace))).source.ray_cast
        scene = ray_cast.ray_scene
        rays = target.get("rays", *size, "RGBA32F", "RGBA32F")
        hits, seen = target.get("hits", *size, "RGBA32UI"), target.get("high", *size, "RGBA32F")
        number, self._count = self._count % len(OFFSETS), self._count + 1
        ray_cast.draw(rays, self._band(OFFSETS[number]).uv_to_clip)
        ray_cast.trace(hits, rays, self._pace)
        cast.look_up(seen, hits, rays, scene.tables, low.to_world[:3, :3].T / np.abs(low.to_world[:3, :3]).max())
        truth = seen.texels()
        cast.heights(seen, hits, rays)
        is_covered, is_hit = truth[..., 3] != 0.0, truth[..., 3] > 0.0
        if not is_covered.any():
            return Deviations(np.inf, np.nan, np.inf, np.zeros(is_covered.shape, np.float32))
        degrees = np.degrees(angles_between(truth[..., :3], self._normals[number])).astype(np.float32)
        degrees[~is_hit] = MISSED
        degrees[~is_covered] = 0.0
        distances = np.abs(seen.texels()[..., 0][is_hit]) * scene.local_space.size
        distance = float(np.percentile(distances, PERCENTILE)) if len(distances) else np.inf
        worst = float(np.percentile(degrees[is_covered], PERCENTILE))
        return Deviations(worst, np.nan, distance / longest_side(original), degrees)
