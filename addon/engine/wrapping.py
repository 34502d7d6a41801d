# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps that wrap around, as tiles: meshes that repeat there, and margins that come in from the other side."""

from dataclasses import replace
from functools import partial

import gpu
import numpy as np

from ..core.declarations.choices import Wrap
from ..core.map_types import BY_NAME, Family, Map
from ..core.settings import MapSettings, SamplingSettings, Settings, TracingSettings
from ..mesh import tiling
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of, world_box
from ..mesh.triangles import face_normals, transformed
from . import ray_maps

AXES = {Wrap.NONE: "", Wrap.U: "u", Wrap.V: "v", Wrap.UV: "uv"}
"""Along which the UVs of a map wrap around."""
NEAR = 0.25
"""Of the shortest step: what rays of a curved low mesh, or of a cage, may lean out of the tile."""
HEIGHTS = 4.0
"""Rays of occlusion without a distance end after one tile, or after so many heights of the high meshes. Against 9 x 9 tiles,
that leaves 0.0004, 0.0015 and 0.0014 in the mean of reliefs with heights of 0.08, 0.16 and 0.55 of the tile. 2 leave 0.009 of
the last one, and 8 leave 0.0001, with four times as many triangles."""


def repeated(meshes: Meshes, settings: Settings) -> Meshes:
    """Meshes that repeat, if the map wraps around. Raises BakeError for a low mesh that is no tile."""
    axes = AXES[Wrap(settings.sampling.wrap)]
    if not axes or not len(meshes.low.triangles):
        return meshes
    low = meshes.whole_low
    repeat = low.remembered(f"repeat {axes}", (), partial(tiling.repeat_of, low, axes))
    reach = max([NEAR * repeat.shortest, *_reaches(meshes, repeat, settings.map, settings.tracing)])
    return replace(meshes, repeat=replace(repeat, reach=reach))


def _reaches(meshes: Meshes, repeat: tiling.Repeat, maps: MapSettings, tracing: TracingSettings) -> list[float]:
    """How far the rays of maps reach, in scene units."""
    space = local_space_of(meshes.highs)
    families = {BY_NAME[name].family for name in maps.drawn_maps}
    reaches = [maps.edge_radius]
    if Family.OPENNESS in families and tracing.ao_distance is not None:
        reaches.append(ray_maps.in_scene(tracing.ao_distance, tracing, space))
    elif Family.OPENNESS in families:
        reaches.append(max(repeat.shortest, HEIGHTS * _height(meshes)))
    if Family.THICKNESS in families:
        reaches.append(ray_maps.thickness_distance(tracing, space))
    if Family.CURVATURE in families:
        reaches.append(ray_maps.curvature_radius(tracing, space))
    return reaches


def _height(meshes: Meshes) -> float:
    """The extent of the high meshes along the mean normal of the low one."""
    low = meshes.whole_low
    normal = face_normals(transformed(low.positions, low.to_world), low.vertices[low.front_triangles]).sum(axis=0)
    return float(np.ptp(world_box(meshes.highs), axis=0) @ np.abs(normal)) / max(float(np.linalg.norm(normal)), 1e-300)


class Around:
    """A map with what comes in on its sides, as far as a margin reaches."""

    def __init__(self, sampling: SamplingSettings):
        most = gpu.capabilities.max_texture_size_get()
        axes = AXES[Wrap(sampling.wrap)]
        self.sides = [
            min(size // 2 if sampling.margin is None else sampling.margin, size // 2, (most - size) // 2)
            if axis in axes
            else 0
            for axis, size in zip("uv", sampling.size, strict=True)
        ]
        self._sampling = sampling

    @property
    def size(self) -> dict[str, int]:
        """Its width and height, as settings."""
        width, height = (size + 2 * side for size, side in zip(self._sampling.size, self.sides, strict=True))
        return {"width": width, "height": height}

    def of(self, values: np.ndarray) -> np.ndarray:
        """It, of a map (height, width, 4)."""
        u, v = self.sides
        return np.pad(values, ((v, v), (u, u), (0, 0)), mode="wrap")

    def inner(self, drawn: Map) -> Map:
        """The map alone."""
        (width, height), (u, v) = self._sampling.size, self.sides
        texels, state = (np.ascontiguousarray(values[v : v + height, u : u + width]) for values in drawn)
        return texels, state
