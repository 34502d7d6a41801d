# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what a viewer sees: high meshes, and a low mesh with its normal map, from many sides at once.

On each pixel that both cover, the shading error is the angle between their normals. Both sides of faces are seen, and the
normals of back faces are turned to the viewer, as renderers do. Engines leave back faces out: those that the high mesh does not
show are counted. On what the low mesh covers alone, and a pixel beside backs of the high mesh, outlines are off, which open
surfaces show from behind, too: the levels of a crater, seen from behind by half of the viewers, would have 0.05, 0.08 and
0.16 % of backs, and no face turned. So it finds what a comparison with hits of rays cannot: a map
that shows a wrong surface exactly, turned faces, a map that is read in a wrong way, and the shape of the low mesh itself.
"""

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from typing import Any

import gpu
import numpy as np

from ..core import udim
from ..core.map_types import Map
from ..core.progress import Progress, Task, part
from ..core.sentences import NOTE, rated
from ..core.settings import Settings
from ..engine import normal_space, separation
from ..engine.planning import Plan
from ..mesh import pixel_middles
from ..mesh.fitting import Samples
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, gap, local_space_of
from ..mesh.triangle_mesh import Mesh, normal_matrix
from ..mesh.triangles import transformed
from ..passes import data_texture, lit, mesh_upload, seen_normals, shader, target
from .deviations import AngleCounts
from .pictures import low_by_tile, square_means

SQUARES = 256
"""Squares along a side of the map, at most, whose angles are kept: enough pixels fall on each."""
TRIANGLES_AT_ONCE = 2**20
"""The most triangles of a high mesh that are drawn at once: between the parts of larger ones, a bake can be canceled."""
DENSE = 2.0
"""Triangles of the high meshes for each pixel of a picture from which most cover no middle of a pixel."""
DRAWN_AT_ONCE = 2**23
"""The most triangles, in all pictures, that are drawn between two steps: drivers without a GPU take a second for them."""
WRONG = 20.0
"""Degrees of the mean error on a square of the map above which it is taken for wrong: the shape of a low mesh alone costs less,
seen from straight above."""
MOST_TEXELS = 4096 * 4096
"""The most texels of a map, in all tiles, that are on the GPU at once: of larger maps, each texel is the mean of several."""
ALONE = 45.0
"""The degrees for which a pixel of one mesh alone counts in the errors of places."""
BEHIND = 2.0
"""Pixels that a place may lie behind what a viewer sees, by the slope of the surface there, and still be seen."""
FILLED = 0.98
"""Share of a picture's side that the sphere around the meshes takes."""


_kept: list[list["SeenHighs"]] = []
"""What is kept in each block of `kept_pictures`."""


@dataclass(frozen=True)
class Detail:
    """How closely is looked.

    Attributes:
        views: Their number, evenly spread over the sphere.
        side: Of a picture, in pixels.
    """

    views: int = 40
    side: int = 512


USUAL = Detail()
"""How closely bakes are looked at."""


@dataclass(frozen=True)
class ShownMap:
    """A normal map as programs read it.

    Attributes:
        tiles: By UDIM tile, its texels (rows, columns, 4) float32 as they are stored, of the same size; without UDIM a single
            one, which repeats.
        read: From lit.reading.
        is_udim: Whether it has tiles; otherwise it repeats.
    """

    tiles: Mapping[int, np.ndarray]
    read: tuple[int, int, int]
    is_udim: bool = False


@dataclass(frozen=True)
class Appearance:
    """What was seen.

    Attributes:
        mean, median, percentile_95, percentile_99, maximum: Of the shading error in degrees, over all pixels that both cover.
        silhouette: The share of the pixels of either that one covers alone.
        backs: The share of them at which the low mesh shows a back face, and the high mesh a front, with no back a pixel beside
            it.
        distance: Between both surfaces along the view, at the 99th percentile, as a share of the diagonal of the box around
            both.
        pixels: The number compared.
        worst_view: The direction (3,) in world space towards the viewer who sees the largest mean error.
        squares: By UDIM tile, the mean error on each square of the map, (rows, columns) float32, in degrees; views count by how
            straight they meet the square. NaN where none does.
        places: As SeenPlaces has them, (N,), the sum of the errors that all viewers see there, who count in the same way.
    """

    mean: float
    median: float
    percentile_95: float
    percentile_99: float
    maximum: float
    silhouette: float
    backs: float
    distance: float
    pixels: int
    worst_view: tuple[float, float, float]
    squares: Mapping[int, np.ndarray] = field(repr=False, compare=False)
    places: np.ndarray | None = field(default=None, repr=False, compare=False)

    @property
    def is_wrong(self) -> dict[int, np.ndarray]:
        """By UDIM tile, the squares (rows, columns) bool with an error of more than WRONG degrees."""
        return {tile: np.nan_to_num(degrees) > WRONG for tile, degrees in self.squares.items()}

    @property
    def wrong(self) -> tuple[int, int]:
        """The number of squares that are wrong, and of all that were seen."""
        seen = sum(int(np.count_nonzero(np.isfinite(degrees))) for degrees in self.squares.values())
        return sum(int(np.count_nonzero(squares)) for squares in self.is_wrong.values()), seen

    def to_dict(self) -> dict[str, Any]:
        """As Report.appearance has it."""
        values = {each.name: getattr(self, each.name) for each in fields(self) if each.repr}
        count, seen = self.wrong
        return {**values, "worst_view": list(self.worst_view), "wrong": count / max(1, seen)}


def measure(
    highs: Sequence[Mesh],
    low: Mesh,
    shown: ShownMap | None,
    *,
    others: Mesh | None = None,
    detail: Detail | None = None,
    is_quick: bool = False,
) -> Task[Appearance | None]:
    """Measure one low mesh. Returns None if no pixel shows both it and a high mesh. To compare several low meshes with the same
    high ones, do so within `kept_pictures`.

    Args:
        highs, low: in world space by their matrices. `low` has the tangents of its map, if that is in tangent space.
        shown: its map; None for its own normals.
        others: a part of the low mesh that hides what is behind it, and is not judged.
        detail: USUAL if None.
        is_quick: whether a quarter of the pixels does.
    """
    around = [low, *([others] if others is not None else [])]
    seen = yield from part(seen_highs(highs, around, detail), 0.0, 0.5)
    seen = seen.half if is_quick else seen
    return (yield from part(seen.compare(low, shown, others=others), 0.5, 1.0))


@contextmanager
def kept_pictures() -> Iterator[None]:
    """Within this block, the pictures of the last high meshes stay on the GPU: more low meshes are compared with the same ones
    at once."""
    kept: list[SeenHighs] = []
    _kept.append(kept)
    try:
        yield
    finally:
        _kept[:] = [each for each in _kept if each is not kept]


def seen_highs(highs: Sequence[Mesh], around: Sequence[Mesh], detail: Detail | None = None) -> "Task[SeenHighs]":
    """High meshes with their pictures, which have room for those `around`, too: those that are kept, if they suit."""
    kept = _kept[-1] if _kept else []
    if not (kept and kept[0].suits(highs, around, detail)):
        kept[:] = []
        seen = SeenHighs(highs, [*highs, *around], detail)
        yield from seen.draw()
        kept.append(seen)
    return kept[0]


def why_not(plan: Plan, settings: Settings) -> str:
    """Why the shading error of a bake cannot be measured, as a clause; empty if it can."""
    if not settings.map.normal:
        return "there is no normal map"
    if settings.map.detail_maps and plan.meshes.has_detail:
        return "the high meshes' own normal and bump maps are not drawn for it"
    if settings.map.edge_radius:
        return "edges are not rounded for it"
    if "swiftshader" in gpu.platform.renderer_get().casefold():
        return "SwiftShader does not test for depth"
    return ""


class SeenBake:
    """Collects the tiles of the normal map of a bake, and measures it.

    warnings: why nothing can be measured, in sentences.
    """

    def __init__(self, plan: Plan, settings: Settings):
        self._plan, self._settings = plan, settings
        self._tiles: dict[int, np.ndarray] = {}
        reason = why_not(plan, settings)
        self.warnings = rated([f"The shading error was not measured: {reason}."] if reason else [], NOTE)

    def add(self, tile: int, kept: Map) -> None:
        """Add a UDIM tile as images and files keep it. Its texels must not change."""
        if self.warnings:
            return
        shown, state = kept
        columns, rows = self._settings.sampling.size
        factor = math.ceil(math.sqrt(columns * rows * len(self._plan.tiles) / MOST_TEXELS))
        if factor > 1:
            means, is_known = square_means(shown, state != 0, factor)
            shown = np.dstack([means, is_known.astype(np.float32)])
        self._tiles[tile] = shown

    def measured(self) -> Task[Appearance | None]:
        """Measure the map. Returns None if it cannot be, or if no pixel shows both meshes."""
        if not self._tiles:
            return None
        meshes, settings = self._plan.meshes, self._settings
        shown = ShownMap(self._tiles, normal_space.reading(settings.map), settings.sampling.udim)
        result = yield from measure(self._highs(), meshes.basis or meshes.low, shown, others=_other_materials(meshes))
        self._tiles = {}
        return result

    def _highs(self) -> list[Mesh]:
        """The high meshes where the low one is: for Flatten, they may be beside it."""
        meshes, highs = self._plan.meshes, self._plan.drawn_highs
        if self._plan.casts_rays or gap(meshes.low, highs) == 0.0:
            return highs
        texels = separation.sample(separation.quick_probe(meshes), self._settings.sampling.size, self._plan.tiles)
        back = np.eye(4)
        back[:3, 3] = -separation.offset(texels, self._plan.method)
        return [replace(high, to_world=back @ high.to_world) for high in highs]


def _other_materials(meshes: Meshes) -> Mesh | None:
    """The part of the low mesh that is not in the texture set; None without texture sets."""
    if meshes.whole is None:
        return None
    is_other = np.ones(len(meshes.whole.triangles), bool)
    is_other[meshes.kept] = False
    return meshes.whole.with_triangles(is_other)


class SeenHighs:
    """High meshes as they are seen from outside: drawn once, and compared with any number of low meshes.

    around: the meshes that pictures have room for. The pictures take 16 bytes of GPU memory a pixel, until this is deleted.
    """

    def __init__(self, highs: Sequence[Mesh], around: Sequence[Mesh], detail: Detail | None = None):
        self.detail = detail or USUAL
        self.space = local_space_of(around)
        self.frame = _Frame.around(around, self.space)
        self.directions = directions(self.detail.views)
        self._content = _content(highs)
        self._highs = highs
        self._views = [self.frame.view(towards) for towards in self.directions]
        self._pictures: list[gpu.types.GPUTexture] = []

    def suits(self, highs: Sequence[Mesh], around: Sequence[Mesh], detail: Detail | None) -> bool:
        """Whether the pictures show these high meshes, and have room for those `around`."""
        is_alike = self.detail == (detail or USUAL) and self._content == _content(highs)
        return is_alike and all(map(partial(self.frame.has_room, space=self.space), around))

    def draw(self) -> Task[None]:
        """Draw the pictures of the high meshes. Call this once, before `compare`."""
        side, count = self.detail.side, sum(len(high.triangles) for high in self._highs)
        pictures = [target.Target(side, side, seen_normals.FORMATS) for _ in self._views]
        done, is_first = 0, True
        for high in self._highs:
            points = self.space.points(high)
            for first in range(0, len(high.triangles), TRIANGLES_AT_ONCE):
                triangles = high.front_triangles[first : first + TRIANGLES_AT_ONCE]
                batch_for = _batches(high, points, triangles, side if count > DENSE * side**2 else None)
                views = list(zip(pictures, self._views, strict=True))
                at_once = max(1, DRAWN_AT_ONCE // len(triangles))
                for start in range(0, len(views), at_once):
                    some = views[start : start + at_once]
                    for into, view in some:
                        mesh = batch_for(view), normal_matrix(high.to_world)
                        seen_normals.draw_high(into, [mesh], view, clear=is_first)
                    some[-1][0].finish()  # so that the driver frees the part before the next one is uploaded
                    share = (start + len(some)) / len(views)
                    yield Progress("Looking at the high mesh", (done + share * len(triangles)) / count)
                done, is_first = done + len(triangles), False
        self._pictures, self._highs = [each.texture for each in pictures], ()

    @cached_property
    def half(self) -> "SeenHighs":
        """The same pictures with every second of their pixels in both directions, for quick looks."""
        result = copy.copy(self)
        result.detail = replace(self.detail, side=self.detail.side // 2)
        shift = np.eye(4)  # by half a pixel of `self`, so that pixels have the middles of those that are taken
        shift[:2, 3] = -1.0 / self.detail.side
        result._views = [shift @ view for view in self._views]
        result._pictures = [seen_normals.half(each, result.detail.side) for each in self._pictures]
        return result

    def places(self, samples: Samples) -> "SeenPlaces":
        """The pixels of places on the high surface, in world space."""
        points, side = (samples.points - self.space.origin) / self.space.size, self.detail.side
        in_views = []
        for picture, view, towards in zip(self._pictures, self._views, self.directions, strict=True):
            depths = target.Target.of(side, side, seen_normals.FORMATS[0], picture).texels()[..., 3]
            in_views.append(_InView.of(points, np.abs(samples.normals @ towards), depths, view))
        return SeenPlaces(len(points), in_views)

    def compare(
        self, low: Mesh, shown: ShownMap | None, *, others: Mesh | None = None, places: "SeenPlaces | None" = None
    ) -> Task[Appearance | None]:
        """Measure a low mesh, as `measure` does. places: whose errors are wanted, too."""
        seen = _Seen(self.directions, self.frame, _Squares.of(shown))
        parts = [*self._parts(low, shown, seen.squares), *(self._hiding(others) if others is not None else [])]
        of_places = np.zeros(places.count if places is not None else 0)
        for number, (picture, view) in enumerate(zip(self._pictures, self._views, strict=True), start=1):
            into = target.get("appearance", self.detail.side, self.detail.side, *seen_normals.FORMATS)
            seen_normals.compare(into, picture, parts, view)
            texels = into.texels()
            seen.add(texels)
            if places is not None:
                of_places += places.in_views[number - 1].errors(texels, len(of_places))
            yield Progress("Looking at the low mesh", number / len(self._views))
        result = seen.result()
        return replace(result, places=of_places) if result is not None and places is not None else result

    def _parts(self, low: Mesh, shown: ShownMap | None, squares: "_Squares") -> Iterator[tuple]:
        """The low mesh as seen_normals.compare takes it."""
        nothing = data_texture.image(np.zeros((1, 1, 4), np.float32))
        read = lit.reading(lit.OBJECT) if shown is None else shown.read
        tiles = {udim.FIRST: None} if shown is None else shown.tiles
        kind = seen_normals.OWN_NORMALS if shown is None else seen_normals.MAP_NORMALS
        drawn = low_by_tile(low, self.space.points(low), tiles, is_udim=shown is not None and shown.is_udim)
        for tile, batch in drawn:
            how = lit.reading(lit.OBJECT), seen_normals.NOT_JUDGED
            texture = nothing
            if tile is not None:
                how, texels = (read, kind), tiles[tile]
                texture = nothing if texels is None else data_texture.image(texels)
            first = 0 if tile is None else squares.first(tile)
            yield batch, texture, seen_normals.low_shading(low.normal_matrix, *how, squares.size, first)

    def _hiding(self, others: Mesh) -> Iterator[tuple]:
        """The part of the low mesh that is not judged."""
        (batch,) = (
            batch for _, batch in low_by_tile(others, self.space.points(others), {udim.FIRST: None}, is_udim=False)
        )
        shading = seen_normals.low_shading(others.normal_matrix, lit.reading(lit.OBJECT), seen_normals.NOT_JUDGED)
        yield batch, data_texture.image(np.zeros((1, 1, 4), np.float32)), shading


def _content(meshes: Sequence[Mesh]) -> list[tuple]:
    """Equal for meshes that look alike."""
    arrays = "positions", "vertices", "normals", "triangles"
    return [(mesh.checksums(*arrays), mesh.to_world.tobytes()) for mesh in meshes]


@dataclass(frozen=True)
class SeenPlaces:
    """Places on the high surface, as SeenHighs.places finds them.

    Attributes:
        count: Their number.
        in_views: Those that each viewer sees.
    """

    count: int
    in_views: Sequence["_InView"]


@dataclass(frozen=True)
class _InView:
    """The places that one viewer sees.

    Attributes:
        which: (S,) int, their numbers.
        pixels: (S,) int, their pixels, row by row.
        facing: (S,), how straight the viewer meets the surface, from 0 to 1.
    """

    which: np.ndarray
    pixels: np.ndarray
    facing: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, facing: np.ndarray, depths: np.ndarray, view: np.ndarray) -> "_InView":
        """points: (N, 3) in the space of `view`. facing: (N,). depths: (side, side), as seen_normals.draw_high has them."""
        side = len(depths)
        clip = transformed(points, view)
        column, row, depth = (0.5 * clip.T + 0.5) * [[side], [side], [1.0]]
        pixels = np.clip(row, 0, side - 1).astype(np.int64) * side + np.clip(column, 0, side - 1).astype(np.int64)
        seen = depths.reshape(-1)[pixels]
        seen = np.where(seen > seen_normals.BACK + 0.5, seen - seen_normals.BACK, seen)
        slope = np.sqrt(np.maximum(1.0 - facing**2, 0.0)) / np.maximum(facing, 0.1)
        which = np.flatnonzero((seen > 0.0) & (depth <= seen - 1.0 + BEHIND / side * (1.0 + slope)))
        return cls(which, pixels[which], facing[which])

    def errors(self, texels: np.ndarray, count: int) -> np.ndarray:
        """The error that the viewer sees at each of `count` places, in degrees, by how straight.

        texels: as seen_normals.compare writes them.
        """
        known = texels[..., 0].reshape(-1)[self.pixels]
        is_alone = (known == seen_normals.LOW_ALONE) | (known == seen_normals.HIGH_ALONE)
        is_wrong = is_alone | (texels[..., 3].reshape(-1)[self.pixels] < 0.0)
        degrees = np.where(is_wrong, ALONE, np.maximum(known - 1.0, 0.0))
        return np.bincount(self.which, self.facing * degrees, count)


def directions(count: int) -> np.ndarray:
    """Directions (count, 3) float64 to viewers, evenly spread over the sphere: a Fibonacci lattice."""
    numbers = np.arange(count)
    z = 1.0 - (2.0 * numbers + 1.0) / count
    angles = numbers * np.pi * (3.0 - np.sqrt(5.0))
    around = np.sqrt(1.0 - z**2)
    return np.stack([around * np.cos(angles), around * np.sin(angles), z], axis=1)


@dataclass(frozen=True)
class _Frame:
    """What a picture shows: the sphere around all meshes, in a local space.

    Attributes:
        diagonal: Of the box around them.
    """

    center: np.ndarray
    radius: float
    diagonal: float

    @classmethod
    def around(cls, meshes: Sequence[Mesh], space: LocalSpace) -> "_Frame":
        """The center is that of the box."""
        parts = []
        for mesh in meshes:
            is_used = np.zeros(len(mesh.positions), bool)  # loose vertices can be anywhere
            is_used[mesh.vertices[mesh.triangles]] = True
            parts.append(space.points(mesh)[is_used])
        least = np.min([points.min(axis=0) for points in parts], axis=0).astype(np.float64)
        most = np.max([points.max(axis=0) for points in parts], axis=0).astype(np.float64)
        center = (least + most) / 2.0
        radius = max(float(np.sqrt(((points - center) ** 2).sum(axis=1).max())) for points in parts)
        return cls(center, max(radius, 1e-6), max(float(np.linalg.norm(most - least)), 1e-6))

    def has_room(self, mesh: Mesh, space: LocalSpace) -> bool:
        """Whether a picture shows all of a mesh."""
        points = space.points(mesh)[np.unique(mesh.vertices[mesh.triangles])]
        return bool((((points - self.center) ** 2).sum(axis=1) <= (self.radius / FILLED) ** 2).all())

    def view(self, towards: np.ndarray) -> np.ndarray:
        """The matrix (4, 4) from the local space to the clip space of a viewer in the direction `towards` (3,)."""
        right = np.cross(np.eye(3)[np.abs(towards).argmin()], towards)
        right /= np.linalg.norm(right)
        axes = np.array((right, np.cross(towards, right), -towards))  # clip space is nearer where z is less
        matrix = np.eye(4)
        matrix[:3, :3] = axes * FILLED / self.radius
        matrix[:3, 3] = -matrix[:3, :3] @ self.center
        return matrix

    def distance(self, depth: float) -> float:
        """A difference of depths, from 0 to 1, as a share of the diagonal."""
        return depth * 2.0 * self.radius / FILLED / self.diagonal


def _batches(
    high: Mesh, points: np.ndarray, triangles: np.ndarray, side: int | None
) -> Callable[[np.ndarray], gpu.types.GPUBatch]:
    """Some triangles (N, 3) of a mesh, as seen_normals.draw_high takes them, for each view (4, 4).

    Args:
        points: (V, 3) float32, of its vertices.
        side: of the pictures, of which a driver without a GPU gets only the triangles that show in them; None for all.
    """

    def uploaded(triangles: np.ndarray) -> gpu.types.GPUBatch:
        corners = triangles.reshape(-1)
        places = np.take(points, high.vertices[corners], axis=0)
        return mesh_upload.upload_corners(position=places, normal=np.take(high.normals, corners, axis=0))

    if side is None or not shader.in_software():
        whole = uploaded(triangles)
        return lambda _: whole
    dense = pixel_middles.Triangles(points, high.vertices[triangles])

    def uploaded_for(view: np.ndarray) -> gpu.types.GPUBatch:
        shown = dense.at_middles(view, side)
        return uploaded(triangles[shown] if len(shown) else triangles[:1])  # there are no empty batches

    return uploaded_for


@dataclass(frozen=True)
class _Squares:
    """The squares of a map.

    Attributes:
        tiles: Their UDIM numbers.
        size: Columns and rows of squares on each.
    """

    tiles: Sequence[int]
    size: tuple[int, int]

    @classmethod
    def of(cls, shown: ShownMap | None) -> "_Squares":
        if shown is None:
            return cls([udim.FIRST], (SQUARES, SQUARES))
        rows, columns = next(iter(shown.tiles.values())).shape[:2]
        return cls(list(shown.tiles), (min(columns, SQUARES), min(rows, SQUARES)))

    @property
    def count(self) -> int:
        """Of one tile."""
        return self.size[0] * self.size[1]

    def first(self, tile: int) -> int:
        """The number of squares before those of a tile."""
        return self.tiles.index(tile) * self.count

    def means(self, sums: np.ndarray, weights: np.ndarray) -> dict[int, np.ndarray]:
        """By tile, (rows, columns) float32, NaN without weight. sums, weights: (N,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            means = np.where(weights > 0.0, sums / weights, np.nan).astype(np.float32)
        return dict(zip(self.tiles, means.reshape(len(self.tiles), *self.size[::-1]), strict=True))


def _facing(alphas: np.ndarray) -> np.ndarray:
    """How much the low mesh faces the viewer, from 0 to 1, by what seen_normals.compare writes."""
    return np.where(alphas < 0.0, -1.0 - alphas, alphas).astype(np.float64)


class _Seen:
    """Collects the pictures of all views."""

    def __init__(self, directions: np.ndarray, frame: _Frame, squares: _Squares):
        self.squares = squares
        self._directions, self._frame = directions, frame
        self._angles, self._distances = AngleCounts(), []
        self._sums: list[float] = []
        self._pixels: list[int] = []
        self._alone = self._backs = 0
        number = len(squares.tiles) * squares.count
        self._by_square, self._weights = np.zeros(number), np.zeros(number)

    def add(self, texels: np.ndarray) -> None:
        """Add a picture (side, side, 4), as seen_normals.compare writes it."""
        pixels = texels.reshape(-1, 4)
        known = pixels[:, 0].copy()  # reading every fourth number several times takes longer
        self._alone += np.count_nonzero(known == seen_normals.LOW_ALONE)
        self._alone += np.count_nonzero(known == seen_normals.HIGH_ALONE)
        self._backs += np.count_nonzero(pixels[:, 3] < 0.0)
        angles, distances, squares, alphas = np.take(pixels, np.flatnonzero(known > 0.0), axis=0).T.copy()
        angles -= np.float32(1.0)
        self._angles.add(angles)
        self._distances.append(distances)
        self._sums.append(float(angles.sum(dtype=np.float64)))
        self._pixels.append(len(angles))
        numbers, facing = squares.astype(np.int64) - 1, _facing(alphas)
        self._by_square += np.bincount(numbers, facing * angles, len(self._weights))
        self._weights += np.bincount(numbers, facing, len(self._weights))

    def result(self) -> Appearance | None:
        """None if no pixel shows both meshes."""
        pixels = sum(self._pixels)
        if not pixels:
            return None
        angles = self._angles.results()
        means = np.array(self._sums) / np.maximum(self._pixels, 1)
        worst = int(means.argmax())
        distance = self._frame.distance(float(np.percentile(np.concatenate(self._distances), 99)))
        return Appearance(
            mean=sum(self._sums) / pixels,
            median=angles["median"],
            percentile_95=angles["percentile_95"],
            percentile_99=angles["percentile_99"],
            maximum=angles["maximum"],
            silhouette=self._alone / (self._alone + pixels),
            backs=self._backs / (self._alone + pixels),
            distance=distance,
            pixels=pixels,
            worst_view=tuple(self._directions[worst].tolist()),
            squares=self.squares.means(self._by_square, self._weights),
        )
