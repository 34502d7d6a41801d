# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how far a coarser level with its map is from the original surface: in degrees, and in distance."""

from dataclasses import dataclass, field, replace

import bpy
import gpu
import numpy as np

from ...core import udim
from ...core.declarations.choices import Directions, Hit, Method, Space
from ...core.map_types import NORMAL
from ...core.progress import Pace, Progress, Task, part
from ...core.settings import Run, Settings
from ...engine import margins, normal_channels, rendering, separation, sources
from ...engine.bands import Band
from ...engine.maps.maps_of_bake import maps_of_bake
from ...engine.method_choice import Plan
from ...mesh import stretch
from ...mesh.inputs import Meshes
from ...mesh.triangle_mesh import Mesh
from ...passes import lit, mesh_upload, target, viewport
from ...scene import mesh_reader

SIDE = 1024
"""The most texels a side of the map that is measured. It is not filtered, so that a larger one would show the same."""
PERCENTILE = 99
"""Of the texels, by which levels are judged."""
FLAT, TREES = 0.2, 0.4
"""Which shares of a measurement are done after drawing the map, and after building the trees for rays."""
MISSED = 180.0
"""The degrees of a texel whose ray meets no original surface."""


@dataclass(frozen=True)
class Deviations:
    """How a level with its map differs from the original surface, on the texels of its map.

    degrees: between the normals that the level shows with its map and those of the original surface where a ray from the level
    meets it, at the 99th percentile. bare_degrees: without the map. distance: along those rays, at the 99th percentile, as a
    share of the longest side of the original's box. by_texel (height, width) float32: the degrees on each texel, 0 on those
    that are not covered.
    """

    degrees: float
    bare_degrees: float
    distance: float
    by_texel: np.ndarray = field(repr=False, compare=False)


def settings_for(settings: Settings) -> Settings:
    """Settings for the normal map alone, by Flatten, on a single tile of at most SIDE texels a side, with one sample."""
    shrink = max(1.0, max(settings.sampling.size) / SIDE)
    return replace(
        settings.without_file().without_other_maps(),
        method=Method.FLATTEN,
        width=max(1, round(settings.sampling.width / shrink)),
        height=max(1, round(settings.sampling.height / shrink)),
        samples=1,
        margin=0,
        normal=True,
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
        basis = stretch.as_read(basis, settings.map.basis)
    meshes = Meshes(low, [original], basis, mesh_reader.smooth_normals(level, low), None, layer, False, [])
    normal_map = yield from part(_flattened(meshes, settings, pace), 0.0, FLAT)
    casting = replace(settings, method=Method.CAST)
    plan = Plan(Method.CAST, (udim.FIRST,), meshes)
    source = yield from part(sources.normal_source(plan, Run(casting, pace)), FLAT, TREES)
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
    run = Run(settings, pace)
    plan = Plan(Method.FLATTEN, (udim.FIRST,), meshes)
    source = yield from part(sources.normal_source(plan, run), 0.0, 0.5)
    renderer = rendering.Renderer(maps_of_bake(meshes, source, run), run)
    drawing = renderer.texels(udim.FIRST, margins.for_maps([meshes.low], settings))
    maps = yield from part(drawing, 0.5, 1.0)
    texels = maps[NORMAL.name][0]
    data = gpu.types.Buffer("FLOAT", texels.size, texels)
    return gpu.types.GPUTexture(settings.sampling.size, format="RGBA32F", data=data)


def _compared(
    basis: Mesh, normal_map: gpu.types.GPUTexture, truth: gpu.types.GPUTexture, settings: Settings
) -> np.ndarray:
    """What viewport.measure_deviation writes, (height, width, 4) float32. basis: the level, with tangents for tangent space."""
    read = (255 if settings.storing.depth == 8 else 0, *normal_channels.reading(settings.map)[1:])
    reading = lit.shading(basis.normal_matrix, read=read)
    level = mesh_upload.upload(basis.triangles, **basis.tangent_space)
    measured = target.get("deviation", settings.sampling.width, settings.sampling.height, "RGBA32F")
    nowhere = np.zeros((1, 1), bool)
    viewport.measure_deviation(measured, level, normal_map, truth, reading, elsewhere=nowhere, stretch=basis.stretch)
    values = np.empty((settings.sampling.height, settings.sampling.width, 4), np.float32)
    measured.read(values)
    return values
