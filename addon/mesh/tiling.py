# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that repeat where a map wraps around: the steps from one tile to the next, as the low mesh has them, and what of high
meshes comes in from the tiles around."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ..core.errors import BakeError
from . import corner_normals, orientation, topology
from .triangle_mesh import Mesh
from .triangles import diagonal, transformed

ON_BORDER = 1e-4
"""In UVs. Corners closer to 0 or 1 are on the border of the map."""
SAME = 1e-3
"""Share of the low mesh's diagonal. Steps of one mesh differ by no more; closed meshes, as a tube, have none."""
JOINED = 3e-5
"""Share of the shorter step. Vertices closer to those of the next tile are joined with them."""
MOST_TILES = 2**12
"""The most tiles that are looked at around one."""


@dataclass(frozen=True)
class Repeat:
    """How a low mesh repeats. Equal for meshes that repeat in the same way.

    Attributes:
        steps: from a tile to the next, in world space, by axis of the UVs ("u", "v"); 0 for meshes that are closed along it.
        lowest: where the low mesh begins along each of `moves`, as multiples of it.
        highest: where it ends.
        reach: how far rays go outside the tile, in scene units.
    """

    steps: tuple[tuple[str, tuple[float, float, float]], ...]
    lowest: tuple[float, ...] = ()
    highest: tuple[float, ...] = ()
    reach: float = 0.0

    def to_dict(self) -> dict[str, list[float]]:
        """`steps`, as core.report.Report has them."""
        return {axis: list(step) for axis, step in self.steps}

    @cached_property
    def moves(self) -> np.ndarray:
        """The steps that have a length (N, 3) float64."""
        return np.array([step for _, step in self.steps if any(step)]).reshape(-1, 3)

    @property
    def shortest(self) -> float:
        """The length of the shortest of `moves`; 0 without any."""
        return float(np.linalg.norm(self.moves, axis=1).min(initial=np.inf)) if len(self.moves) else 0.0

    def copies(self, mesh: Mesh) -> Iterator[tuple[Mesh, np.ndarray]]:
        """What of a high mesh comes in from the tiles around: meshes, each with the numbers (N,) int of its triangles in
        `mesh`. Raises BakeError for a tile that is far smaller than what repeats."""
        if not len(self.moves) or not len(mesh.triangles):
            return
        inverse = np.linalg.pinv(self.moves)
        corners = (transformed(mesh.positions, mesh.to_world) @ inverse)[mesh.vertices[mesh.triangles]]
        first, last = corners.min(axis=1), corners.max(axis=1)
        wider = self.reach * np.linalg.norm(inverse, axis=0)
        begin, end = np.array(self.lowest) - wider, np.array(self.highest) + wider
        least = np.ceil(begin - last.max(axis=0)).astype(np.int64)
        most = np.floor(end - first.min(axis=0)).astype(np.int64)
        if np.prod(np.maximum(most - least + 1, 0), dtype=float) > MOST_TILES:
            raise BakeError(
                f"{mesh.name!r}, and how far rays reach, are more than {MOST_TILES:,} times as large as the tile that wraps "
                "around: set smaller distances, or turn Wrap off."
            )
        for move in itertools.product(*map(range, least.tolist(), (most + 1).tolist())):
            if any(move):
                near = np.flatnonzero(((last + move >= begin) & (first + move <= end)).all(axis=1))
                if len(near):
                    yield _moved(mesh, near, np.array(move) @ self.moves), near

    def joined(self, mesh: Mesh) -> Mesh:
        """A mesh whose smooth normals go on in the next tile where open edges of both meet; those of its own stay. It is made
        once."""
        places = self.places(mesh) if mesh.normals_domain in {"POINT", "CORNER"} else None
        if places is None:
            return mesh
        return mesh.remembered("joined across tiles", (places,), partial(corner_normals.joined_at, mesh, places))

    def places(self, mesh: Mesh) -> np.ndarray | None:
        """The first vertex (V,) int of those that open edges of one tile and of the next have in one place. None if no open
        edges meet."""
        if not len(self.moves):
            return None
        return mesh.remembered(f"places across tiles {self.steps}", (), partial(_places, mesh, self.moves))


def repeat_of(low: Mesh, axes: str) -> Repeat:
    """How a low mesh repeats along some axes of its UVs, "u", "v" or both. Raises BakeError for one that is no tile."""
    points = transformed(low.positions, low.to_world)[low.vertices].astype(np.float64)
    used = points[low.triangles.reshape(-1)]
    steps = tuple((axis, _step(low, points, "uv".index(axis), SAME * diagonal(used))) for axis in axes)
    repeat = Repeat(steps)
    if not len(repeat.moves):
        return repeat
    along = used @ np.linalg.pinv(repeat.moves)
    return replace(repeat, lowest=tuple(along.min(axis=0).tolist()), highest=tuple(along.max(axis=0).tolist()))


def _step(low: Mesh, points: np.ndarray, axis: int, within: float) -> tuple[float, float, float]:
    """The step from the edges at 0 of the UVs to those at 1. points: of the corners (C, 3). within: how much steps differ."""
    name, across = "UV"[axis], low.uv[:, axis]
    corners = low.triangles.reshape(-1)
    extent = f"from {across[corners].min(initial=1.0):.4g} to {across[corners].max(initial=0.0):.4g}"
    if len(corners) and not ((across[corners] > -ON_BORDER) & (across[corners] < 1.0 + ON_BORDER)).all():
        raise BakeError(
            f"{low.name!r} has UVs outside 0 to 1 along {name}, where the map wraps around, {extent}: move them, or turn Wrap "
            "off."
        )
    first, last = (_border(low, axis, end) for end in (0.0, 1.0))
    if len(first) and len(last):
        along = low.uv[:, 1 - axis]
        places = np.unique(along[np.concatenate([first, last])])
        steps = _at(places, along[last], points[last]) - _at(places, along[first], points[first])
        step, is_one = steps.mean(axis=0), all(_is_line(along[of], points[of], within) for of in (first, last))
        if is_one and np.abs(steps - step).max() <= within:
            return tuple(step.tolist()) if np.linalg.norm(step) > within else (0.0, 0.0, 0.0)
    raise BakeError(
        f"{low.name!r} is no tile along {name}: its edges at 0 and at 1 of the UVs, which go {extent}, are to be the same but "
        "for one step, as those of a plane that fills the map. Change its UVs, or turn Wrap off."
    )


def _border(low: Mesh, axis: int, end: float) -> np.ndarray:
    """The corners (N,) int of the edges that lie on a border of the map, each once."""
    is_on = (np.abs(low.uv[:, axis] - end) < ON_BORDER)[low.triangles]
    is_edge = is_on & np.roll(is_on, -1, axis=1)
    return np.unique(low.triangles[is_edge | np.roll(is_edge, 1, axis=1)])


def _at(places: np.ndarray, along: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (N, 3) at places along a border, from those of its corners."""
    order = np.argsort(along, kind="stable")
    return np.stack([np.interp(places, along[order], axis[order]) for axis in points.T], axis=1)


def _is_line(along: np.ndarray, points: np.ndarray, within: float) -> bool:
    """Whether corners at one place of a border are at one point."""
    _, first, same = np.unique(along, return_index=True, return_inverse=True)
    return bool(np.abs(points - points[first][same]).max() <= within)


def _moved(mesh: Mesh, kept: np.ndarray, move: np.ndarray) -> Mesh:
    """Some triangles (N,) int of a mesh, moved in world space; for rays alone."""
    corners = mesh.triangles[kept].reshape(-1)
    used, numbers = topology.numbered(mesh.vertices[corners])
    to_world = mesh.to_world.copy()
    to_world[:3, 3] += move
    triangles = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    vertices, normals = numbers.astype(np.int32), mesh.normals[corners]
    return Mesh(
        mesh.name, mesh.positions[used], vertices, normals, triangles, to_world, normals_domain=mesh.normals_domain
    )


def _places(mesh: Mesh, moves: np.ndarray) -> np.ndarray | None:
    """As Repeat.places."""
    columns = orientation.columns_of(mesh.vertices[mesh.triangles])
    some = np.flatnonzero(orientation.open_vertices(columns, len(mesh.positions)))
    points = mesh.positions[some].astype(np.float64)
    moves = moves @ np.linalg.pinv(mesh.to_world[:3, :3]).T
    within = JOINED * np.linalg.norm(moves, axis=1).min()
    moved = np.concatenate([points + move for move in (np.zeros(3), *moves)])
    same = topology.places(moved, within) % max(1, len(some))
    first = topology.connected(len(some), np.tile(np.arange(len(some)), 1 + len(moves)), same)
    is_across = np.zeros(len(some), bool)
    is_across[first[np.linalg.norm(points - points[first], axis=1) > 4.0 * within]] = True
    if not is_across.any():
        return None
    places, met = np.arange(len(mesh.positions)), is_across[first]  # other open edges stay as they are
    places[some[met]] = some[first[met]]
    return places
