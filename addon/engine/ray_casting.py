# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of a bake, from the low mesh or its cage to the high meshes, on a map and at points."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gpu
import numpy as np

from ..core import udim
from ..core.declarations.choices import Hit
from ..core.progress import Pace
from ..core.udim import UvToClip
from ..mesh.inputs import Meshes
from ..mesh.local_space import FARTHEST, LocalSpace
from ..mesh.subdividing import Pieces
from ..passes import cast, rays, samples, target
from ..passes.samples import Active
from . import low_offset
from .tree_cache import LowSurface, RayScene

TOUCHING = 1e-6
"""In local space. Where a cage is closer than this to the low mesh, rays follow the low mesh's normals."""


@dataclass(frozen=True)
class RayLengths:
    """Distances of rays, in scene units.

    Attributes:
        extrusion: How far outside the low mesh they start; 0 with a cage.
        max_distance: How far they reach.
        blend_width: The distance from hard edges within which directions blend; 0 if they do not.
        low_offset: How far the high meshes lie outside the low one everywhere.
        is_measured: Whether at least one of the first two was measured, not set.
    """

    extrusion: float = 0.0
    max_distance: float = 0.0
    blend_width: float = 0.0
    low_offset: float = 0.0
    is_measured: bool = False

    @property
    def distances(self) -> dict[str, float]:
        """As core.report.Report has them."""
        return {"extrusion": self.extrusion, "max_distance": self.max_distance}


@dataclass(frozen=True)
class RayCast:
    """Rays from a low mesh to the high ones.

    Attributes:
        ray_mesh: From `upload_ray_mesh`.
        extrusion, max_distance: In scene units; with a cage, rays start on it and extrusion is 0.
        hit: Which hit counts.
        is_measured: Whether at least one of the two distances was measured, not set.
        by_order: As cast.Search has it.
        offset: In local space. The high meshes lie so far outside the low one everywhere, which was moved to them. Rays,
            heights and `low` are those of the moved mesh, the two distances are not.
        has_cage: Whether rays start on a cage.
    """

    ray_scene: RayScene
    low: LowSurface
    ray_mesh: gpu.types.GPUBatch
    directions: rays.Directions
    hit: Hit
    extrusion: float
    max_distance: float
    facing_only: bool
    has_cage: bool
    is_measured: bool = False
    offset: float = 0.0
    by_order: bool = False

    def moved(self, meshes: Meshes) -> Meshes:
        """`meshes` with their low mesh where the rays start from."""
        return low_offset.moved(meshes, self._low_offset) if self.offset else meshes

    def of(self, meshes: Meshes) -> "RayCast":
        """The same rays from other meshes, which are not moved yet."""
        return replace(self, ray_mesh=upload_ray_mesh(self.moved(meshes), self.low, self.ray_scene.local_space))

    @property
    def lengths(self) -> RayLengths:
        """What is told of the rays."""
        width = self.directions.blend_width * self.ray_scene.local_space.size
        return RayLengths(self.extrusion, self.max_distance, width, self._low_offset, self.is_measured)

    @property
    def _low_offset(self) -> float:
        """`offset` in scene units."""
        return self.offset * self.ray_scene.local_space.size

    def draw(
        self,
        into: target.Target,
        uv_to_clip: UvToClip,
        some: Active | None = None,
        parts: Sequence[tuple[int, int]] | None = None,
    ) -> None:
        """Draw the rays as `trace` takes them. some: the texels that get one; None for all. parts: of the low mesh, as in
        rays.draw."""
        if some:
            samples.clear_active(into, some)  # the points, whose alpha says whether there is a ray
        unit = self.ray_scene.local_space.size
        rays.draw(
            into,
            self.ray_mesh,
            uv_to_clip,
            self.directions,
            start_offset=self.extrusion / unit - self.offset,
            start_on_cage=self.has_cage,
            clear=not some,
            stopped=some and some.stopped,
            parts=parts,
        )

    def trace(
        self, hits: target.Target, drawn: target.Target, pace: Pace | None = None, some: Active | None = None
    ) -> None:
        """Cast the rays that `draw` has written, as cast.trace does."""
        for _ in self.traced(hits, drawn, pace or Pace(), some):
            pass

    def traced(
        self,
        hits: target.Target,
        drawn: target.Target,
        pace: Pace,
        some: Active | None = None,
        covered: np.ndarray | None = None,
    ) -> Iterator[range]:
        """As `trace`, in slices, as cast.trace_in_slices has them."""
        unit = self.ray_scene.local_space.size
        search = cast.Search(
            self.hit,
            inside=FARTHEST if self.has_cage else (self.max_distance - self.extrusion) / unit + self.offset,
            # Painting moves where rays start, not where they end. From a cage, they have a length instead.
            max_t=self.max_distance / unit if self.has_cage else FARTHEST,
            facing_only=self.facing_only,
            by_order=self.by_order,
        )
        tables, owners = self.ray_scene.tables, self.low.owners
        yield from cast.trace_in_slices(hits, drawn, tables, owners, search, pace=pace, some=some, covered=covered)


def upload_ray_mesh(meshes: Meshes, low_surface: LowSurface, local_space: LocalSpace) -> gpu.types.GPUBatch:
    """The low mesh as rays.draw takes it."""
    arrays = ray_arrays(meshes, local_space)
    starts = low_surface.starts if meshes.kept is None else low_surface.starts[meshes.kept]
    return rays.upload(meshes.low.triangles, starts, uv=meshes.low.uv, **arrays)


def ray_arrays(meshes: Meshes, local_space: LocalSpace) -> dict[str, Any]:
    """What rays.upload takes by corner of the low mesh, without UVs.

    With a cage, which has the same corners, smooth normals lead to the cage.
    """
    low = meshes.low
    positions = local_space.points(low)[low.vertices]
    smooth, straight = (
        low.to_world_normals(normals).astype(np.float32) for normals in (meshes.smooth_normals, low.normals)
    )
    if meshes.cage is not None:
        to_cage = local_space.points(meshes.cage)[meshes.cage.vertices] - positions
        is_touching = np.linalg.norm(to_cage, axis=1) < TOUCHING
        smooth = straight = np.where(is_touching[:, None], smooth * np.float32(TOUCHING), to_cage)
    return {"position": positions, "smooth_normal": smooth, "straight_normal": straight, "paint": _paint(meshes)}


def _paint(meshes: Meshes) -> np.ndarray | None:
    """What the artist painted, as rays.upload takes it."""
    if meshes.offset is None and meshes.straight is None:
        return None
    paint = np.tile(np.array([1.0, 0.0], np.float32), (len(meshes.low.vertices), 1))
    for column, values in enumerate((meshes.offset, meshes.straight)):
        if values is not None:
            paint[:, column] = values
    return paint


TEXEL = np.array([(-0.4, -0.3), (0.4, -0.3), (0.0, 0.5)], np.float32)
"""The corners of a triangle that covers the center of one texel alone, in texels from that center."""


@dataclass(frozen=True)
class RayPoints:
    """Rays at points, all float32, in local space.

    Attributes:
        places (P, 3): The points.
        directions (P, 3): Unit vectors away from the surface; 0 where there is none.
        starts (P,): The distances outside the surface at which the rays start.
    """

    places: np.ndarray
    directions: np.ndarray
    starts: np.ndarray


def rays_at_points(
    meshes: Meshes, pieces: Pieces, local_space: LocalSpace, directions: rays.Directions, *, extrusion: float
) -> RayPoints:
    """The rays at the points of `pieces`, parts of the low mesh's triangles. extrusion: in units of the local space.

    Needs no UVs: each point gets a texel of its own.
    """
    corners, count = meshes.low.triangles, len(pieces.parents)
    arrays = ray_arrays(meshes, local_space)
    by_point: dict[str, Any] = {
        name: None if values is None else pieces.interpolate(values, corners) for name, values in arrays.items()
    }
    side = max(1, int(np.ceil(np.sqrt(count))))
    centers = np.stack(np.divmod(np.arange(count), side)[::-1], axis=1) + 0.5
    batch = rays.upload(
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.ones(count, np.int64),
        uv=((centers[:, None] + TEXEL) / side).reshape(-1, 2).astype(np.float32),
        **{name: None if values is None else np.repeat(values, 3, axis=0) for name, values in by_point.items()},
    )
    drawn = target.Target(side, side, ("RGBA32F", "RGBA32F"))
    rays.draw(
        drawn,
        batch,
        udim.uv_to_clip(),
        directions,
        start_offset=extrusion,
        start_on_cage=meshes.cage is not None,
    )
    away = drawn.texels(1).reshape(-1, 4)[:count]
    return RayPoints(by_point["position"], away[:, :3], away[:, 3])
