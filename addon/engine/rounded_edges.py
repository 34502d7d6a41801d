# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds the hard edges of the high meshes: their normals alone, within a radius."""

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np

from ..core.errors import BakeError, Length, shorten_list
from ..core.progress import Progress, Task, relay
from ..core.settings import Run, Settings
from ..mesh import bvh
from ..mesh.inputs import Meshes
from ..mesh.local_space import world_box
from ..mesh.smooth_parts import SmoothParts, smooth_parts
from ..mesh.tiling import Repeat
from ..mesh.triangle_mesh import Mesh
from ..passes import rounding
from .high_meshes import HighSurface
from .map_families import Sample


class RoundedEdges:
    """Rounds the normals of samples near hard edges of the high meshes.

    to_space: the matrix (3, 3) from world normals to the space of the source's normals.
    """

    has_images = False

    def __init__(self, surface: HighSurface, to_space: np.ndarray, run: Run):
        self.surface, self.to_space, self.run = surface, to_space, run
        self.radius = run.settings.map.edge_radius / surface.local_space.size
        self.edges = _upload(surface, run.settings.map.edge_radius)

    def apply(self, drawn: Sequence[Sample]) -> Task[None]:
        """Change the normals of these samples in place."""
        if self.edges is None:
            return
        for number, sample in enumerate(drawn):
            rows = rounding.round_in_slices(
                sample.normals,
                sample.hits,
                self.surface.tables,
                self.edges,
                self.radius,
                to_space=self.to_space,
                pace=self.run.pace,
                covered=sample.covered,
            )
            for done in relay(rows, within=partial(self.run.timings.timed, "draw")):
                if self.run.pace.has_listener:
                    share = done.stop / sample.band.height
                    yield Progress("Rounding edges", (number + share) / len(drawn))


def _upload(surface: HighSurface, radius: float) -> rounding.HardEdges | None:
    """The hard edges of a surface, also those of the tiles around it within a radius in scene units; None if it has none."""
    repeat, numbers, ends, beside, parts = surface.ray_scene.repeat, [], [], [], 0
    for high in surface.highs:
        found = _parts_of(high, repeat)
        if found is None:
            numbers.append(np.full(len(high.triangles), parts))
            parts += 1
            continue
        numbers.append(found.numbers + parts)
        ends.append(surface.local_space.points(high)[found.ends])
        beside.append(found.beside + parts)
        parts += int(found.numbers.max()) + 1
    if not ends:
        return None
    points, sides = np.concatenate(ends), np.concatenate(beside)
    if repeat is not None:
        moves = (_moves(repeat, radius) / surface.local_space.size).astype(np.float32)
        points, sides = (points + moves[:, None, None, :]).reshape(-1, 2, 3), np.tile(sides, (len(moves), 1))
    tree = bvh.build(points.reshape(-1, 3), np.arange(2 * len(points)).reshape(-1, 2)[:, [0, 1, 1]])
    of_hits = np.concatenate(numbers)[surface.ray_scene.order]
    return rounding.upload_hard_edges(tree, points[tree.order], sides[tree.order], of_hits)


def _parts_of(high: Mesh, repeat: Repeat | None) -> SmoothParts | None:
    joined = None if repeat is None else repeat.places(high)
    return high.remembered("smooth parts", (joined,), partial(smooth_parts, high, joined))


def _moves(repeat: Repeat, radius: float) -> np.ndarray:
    """The ways (N, 3) from a tile to itself and to those around it within a radius."""
    if not len(repeat.moves):
        return np.zeros((1, 3))
    far = 1 + int(radius / repeat.shortest)
    return np.array(list(itertools.product(range(-far, far + 1), repeat=len(repeat.moves)))) @ repeat.moves


def check_radius(meshes: Meshes, radius: float, length: Length) -> None:
    """Raise BakeError for an edge radius that is larger than the high meshes. length: a length in scene units as text."""
    if not radius:
        return
    low, high = world_box(meshes.highs)
    diagonal = float(np.linalg.norm(high - low))
    if radius > diagonal:
        raise BakeError(
            f"Edge Radius is {length(radius)}, more than the high meshes measure from corner to corner, {length(diagonal)}: "
            "set a shorter one."
        )


def notes(meshes: Meshes, settings: Settings) -> list[str]:
    """A sentence if edges are to be rounded and none is hard. meshes: as they were drawn."""
    if not settings.map.edge_radius or has_hard_edges(meshes):
        return []
    names = shorten_list(repr(high.name) for high in meshes.listed_highs)
    return [f"Edge Radius rounds nothing: no edge of {names} is hard. Mark edges sharp, or shade faces flat."]


def has_hard_edges(meshes: Meshes) -> bool:
    """Whether an edge of the high meshes is hard, so that there is something to round."""
    return any(_parts_of(high, meshes.repeat) is not None for high in meshes.highs)
