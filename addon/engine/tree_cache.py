# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays need of the meshes on the GPU: triangles and trees of high and low meshes, built, uploaded, and cached."""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core import threads
from ..core.errors import BakeError
from ..core.progress import Timings
from ..mesh import bvh, edges, shared_values
from ..mesh import cutouts as of_mesh
from ..mesh.local_space import LocalSpace, local_space_of
from ..mesh.tiling import Repeat
from ..mesh.triangle_mesh import Mesh
from ..passes import allocation, cast, data_texture, rays
from . import cutouts

BEND = np.cos(np.radians(30.0))
"""The cosine of the angle between two faces from which a hard edge is a feature of the shape. With flat shading, all edges are
hard."""

ROOM = 0.03
"""Share of the low mesh's diagonal that rays search on both sides at least, if hits have owners: parts that stand off the
surface are few, so that measuring does not see them all."""
PLACES = 0.2, 0.4, 0.6, 0.8
"""Where on a hard edge the points lie, as shares of its length."""


@dataclass(frozen=True)
class LowSurface:
    """The low mesh as rays see it.

    Attributes:
        owners: Its tree.
        numbers (T,) int: Of its triangles in the tree, from 1.
        starts (T,) int: Of the triangles where walks for their hits start.
        edges: Its hard edges; none if none of them is a feature of the shape.
        sharp: Points on those that are, or None.
    """

    owners: cast.Owners
    numbers: np.ndarray
    starts: np.ndarray
    edges: rays.Edges
    sharp: "SharpPoints | None"

    @property
    def bytes(self) -> int:
        """The GPU memory of both trees."""
        return data_texture.size_of(self.owners.tree.nodes, self.owners.corners, self.edges.tree.nodes, self.edges.ends)


@dataclass(frozen=True)
class SharpPoints:
    """Points on hard edges.

    places (N, 3) float32 in local space.

    Attributes:
        vertices (N, 2) int: The ends of each point's edge.
        cosines (N,): Of half the angle between the faces' normals.
    """

    places: np.ndarray
    vertices: np.ndarray
    cosines: np.ndarray


def build_low_surface(low: Mesh, local_space: LocalSpace, *, has_clearances: bool = True) -> LowSurface:
    """Build and upload the tree over `low` and the one over its hard edges. Raises BakeError for too many triangles.

    has_clearances: as cast.upload_owners has it.
    """
    if not low_fits(low):
        raise BakeError(
            f"{low.name!r} has {len(low.triangles):,} triangles;"
            f" rays take at most {_most_low_triangles():,} of the low mesh on this GPU."
        )
    points = local_space.points(low)
    vertices = np.take(low.vertices, low.front_triangles, mode="clip")  # the winding decides where faces point
    tree = bvh.build(points, vertices)
    ordered = vertices[tree.order]
    corners, has_area = points[ordered], edges.has_area(points, ordered)
    # In one point, a triangle has a normal of exactly 0 on any GPU, which agrees with no hit.
    corners[~has_area] = corners[~has_area][:, :1]
    across, nearest = edges.past_flat(points, ordered, has_area)
    room = ROOM * 2.0 * local_space_of([low]).size / local_space.size
    uploaded = cast.upload_owners(tree, corners, across, room, has_clearances=has_clearances)
    numbers = np.empty(len(vertices), np.int64)
    numbers[tree.order] = np.arange(1, len(vertices) + 1)
    starts = 1 + nearest[numbers - 1]
    return LowSurface(uploaded, numbers, starts, *upload_hard_edges(low, local_space))


def low_fits(low: Mesh) -> bool:
    """Whether rays take so many triangles of a low mesh on this GPU."""
    return len(low.triangles) <= _most_low_triangles()


def _most_low_triangles() -> int:
    return min(rays.MOST_TRIANGLES, data_texture.limit() // cast.OWNER_TEXELS)


def upload_hard_edges(low: Mesh, local_space: LocalSpace) -> tuple[rays.Edges, SharpPoints | None]:
    """Upload the hard edges of `low`, as LowSurface has them, and the points on those that are features of the shape."""
    points, (ends, cosines) = local_space.points(low), edges.hard_edges(low)
    is_sharp = cosines < BEND
    if not is_sharp.any():
        return rays.no_edges(), None
    tree = bvh.build(points, ends[:, [0, 1, 1]])
    uploaded = rays.upload_edges(tree, points[ends[tree.order]])
    # Each place is on the edge itself, where another part may hide it: several on each edge see more.
    sharp = np.repeat(ends[is_sharp], len(PLACES), axis=0)
    half = np.repeat(np.sqrt(0.5 * (1.0 + np.clip(cosines[is_sharp], -1.0, 1.0))), len(PLACES))
    along = np.tile(np.array(PLACES, np.float32), np.count_nonzero(is_sharp))[:, None]
    return uploaded, SharpPoints(points[sharp[:, 0]] * (1.0 - along) + points[sharp[:, 1]] * along, sharp, half)


CACHE_BYTES = 1024 * 2**20
"""The most GPU memory for cached trees."""
CACHED_TREES = 4
"""The most trees in the cache. Each change of a high mesh adds a tree."""


@dataclass(frozen=True)
class RayScene:
    """What rays can hit: all high meshes.

    Attributes:
        local_space: Of the tree.
        tables: The tree on the GPU.
        order (T,) int: The triangles, numbered mesh after mesh, in the order of the tree; some several times if they repeat.
        repeat: How they repeat; None if they do not.
    """

    local_space: LocalSpace
    tables: cast.Tables
    order: np.ndarray
    repeat: Repeat | None = None


class TreeCache:
    """Trees over high meshes and over low ones, cached on the GPU while the meshes stay the same.

    most_bytes: the limit for all together. most_trees: for those of high meshes, and for those of low ones. Beyond them, the
    tree that was used longest ago is freed first, except the last one of each.
    """

    def __init__(self, most_bytes: int = CACHE_BYTES, most_trees: int = CACHED_TREES):
        self.most_bytes, self.most_trees = most_bytes, most_trees
        self.built = 0
        """How many trees were built since the start."""
        self._scenes: OrderedDict[tuple, RayScene] = OrderedDict()
        self._lows: OrderedDict[tuple, LowSurface] = OrderedDict()

    def __len__(self) -> int:
        return len(self._scenes)

    @property
    def scenes(self) -> list[RayScene]:
        """The cached trees, the one used longest ago first."""
        return list(self._scenes.values())

    @property
    def bytes(self) -> int:
        """The GPU memory of the cached trees."""
        scenes, lows = self._scenes.values(), self._lows.values()
        return sum(scene.tables.bytes for scene in scenes) + sum(low.bytes for low in lows)

    def ray_scene_of(
        self,
        highs: Sequence[Mesh],
        timings: Timings,
        like: RayScene | None = None,
        repeat: Repeat | None = None,
    ) -> RayScene:
        """The tree over `highs`, built and uploaded unless it is cached.

        like: of the same triangles, whichever of them were turned over: their boxes, and so the tree, are the same. repeat: how
        they repeat, for what reads hits as well.

        The key is the content, not the name: Blender does not report every change of a mesh. Raises BakeError for more
        triangles than the tables take.
        """
        if not fits(highs):
            raise BakeError(f"The high meshes have {_count(highs):,} triangles together; {_most('Cast')}.")
        with timings.timed("tree"):
            key = (*map(checksums, highs), repeat)
            scene = self._scenes.pop(key, None)
            if scene is None:
                scene = _uploaded(highs, timings, has_tree=True, like=like, repeat=repeat)
                self.built += like is None
            self._scenes[key] = scene
            while len(self) > 1 and (len(self) > self.most_trees or self.bytes > self.most_bytes):
                self._scenes.popitem(last=False)
        return scene

    def low_surface_of(
        self, low: Mesh, local_space: LocalSpace, timings: Timings, *, has_clearances: bool = True
    ) -> LowSurface:
        """What rays need of `low`, built and uploaded unless it is cached. Raises BakeError for too many triangles.

        has_clearances: whether most texels ask for the owners of their hits. Otherwise measuring them takes longer than it
        saves.
        """
        with timings.timed("tree"):
            key = (*checksums(low), *local_space.origin.tolist(), local_space.size, has_clearances)
            surface = self._lows.pop(key, None)
            if surface is None:
                surface = build_low_surface(low, local_space, has_clearances=has_clearances)
            self._lows[key] = surface
            while len(self._lows) > 1 and (len(self._lows) > self.most_trees or self.bytes > self.most_bytes):
                self._lows.popitem(last=False)
        return surface

    def trim(self) -> None:
        """Free all trees if together they hold more than `most_bytes`."""
        if self.bytes > self.most_bytes:
            self.free()

    def free(self) -> None:
        """Free all trees."""
        self._scenes.clear()
        self._lows.clear()


def checksums(mesh: Mesh) -> tuple:
    """What tells what rays meet of a mesh from another one."""
    of_shape = mesh.checksums("positions", "vertices", "normals", "triangles", "to_world")
    return *of_shape, *of_mesh.checksums(mesh)


trees = TreeCache()
"""The cache that bakes share."""
allocation.held.append(lambda: trees.bytes)


def without_tree(highs: Sequence[Mesh], timings: Timings) -> RayScene:
    """The triangles of `highs` in their own order, to read what is at hits. No ray can be cast at them."""
    if not fits(highs):
        others = "Flatten, for other maps than the normal map, and materials with normal or bump maps,"
        raise BakeError(f"The high meshes have {_count(highs):,} triangles together; {_most(others)}.")
    return _uploaded(highs, timings, has_tree=False)


def variant(highs: Sequence[Mesh], like: RayScene, timings: Timings) -> RayScene:
    """The triangles of `like`, some of them turned over or in one point, in its tree. Not cached."""
    return _uploaded(highs, timings, has_tree=True, like=like)


def fits(highs: Sequence[Mesh]) -> bool:
    """Whether the triangles of `highs` together, and their vertices, fit in the GPU's textures."""
    return max(_count(highs), sum(len(high.positions) for high in highs)) <= most_triangles()


def most_triangles() -> int:
    """The most triangles of all high meshes together, and the most vertices, that rays take on this GPU."""
    return data_texture.limit()


def _count(highs: Sequence[Mesh]) -> int:
    return sum(len(high.triangles) for high in highs)


def _most(who: str) -> str:
    return f"{who} takes at most {most_triangles():,} triangles, and as many vertices, on this GPU"


def _uploaded(
    highs: Sequence[Mesh],
    timings: Timings,
    *,
    has_tree: bool,
    like: RayScene | None = None,
    repeat: Repeat | None = None,
) -> RayScene:
    local_space, copies = local_space_of(highs), [] if repeat is None else _copies(highs, repeat)
    points, vertices, normals, own_normals = _arrays([*highs, *(copy for copy, _ in copies)], local_space)
    if like is not None:
        with timings.timed("upload"):
            vertices, own_normals = threads.take(vertices, like.order), own_normals[like.order]
            clear = cutouts.records_of(highs, like.order)
            tables = cast.upload(like.tables.tree, points, vertices, normals, own_normals, clear=clear)
            return RayScene(local_space, tables, like.order)
    if has_tree:
        tree = bvh.build(points, vertices)
    else:
        tree = bvh.Tree(np.arange(len(vertices)), np.zeros((1, 3, 4), np.float32), 0, np.zeros(3), np.ones(3))
    with timings.timed("upload"):
        if has_tree:
            vertices, own_normals = threads.take(vertices, tree.order), own_normals[tree.order]
        order = tree.order
        if copies:
            order = np.concatenate([np.arange(_count(highs)), *(numbers for _, numbers in copies)])[order]
        clear = cutouts.records_of(highs, order)
        tables = cast.upload(tree, points, vertices, normals, own_normals, clear=clear)
    return RayScene(local_space, tables, order, repeat)


def _copies(highs: Sequence[Mesh], repeat: Repeat) -> list[tuple[Mesh, np.ndarray]]:
    """What comes in from the tiles around, as Repeat.copies has it, with triangles numbered mesh after mesh."""
    copies, first = [], 0
    for high in highs:
        copies += [(copy, first + numbers) for copy, numbers in repeat.copies(high)]
        first += len(high.triangles)
    every = [*highs, *(copy for copy, _ in copies)]
    if not fits(every):
        raise BakeError(
            f"The high meshes have {_count(every):,} triangles together with the tiles around; {_most('Cast')}: set a smaller "
            "AO distance."
        )
    return copies


def _arrays(highs: Sequence[Mesh], local_space: LocalSpace) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All meshes as one, in a local space: points (V, 3), vertices of the triangles (T, 3), and normals (N, 3) with the places
    of the triangles' own (T,), as shared_values.joined has them."""
    points, vertices, shared, before = [], [], [], 0
    for high in highs:
        triangles = high.front_triangles  # the winding decides whether a ray hits the front or the back
        points.append(local_space.points(high))
        of_vertices, others, own = shared_values.share(
            len(high.positions), high.vertices, high.normals, triangles, high.normals_domain
        )
        of_vertices = None if of_vertices is None else high.to_world_normals(of_vertices)
        shared.append((of_vertices, high.to_world_normals(others), own))
        numbers = threads.take(high.vertices, triangles)
        vertices.append(numbers + before if before else numbers)
        before += len(high.positions)
    normals, own_normals = shared_values.joined(shared, [len(high.positions) for high in highs])
    points, vertices = (parts[0] if len(parts) == 1 else np.concatenate(parts) for parts in (points, vertices))
    return points, vertices, normals, own_normals
