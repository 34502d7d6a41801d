# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts a ray from each texel of the low mesh to the high meshes, decides which hit belongs to the texel, and reads the
surface there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.declarations.choices import Hit
from ..core.progress import SLICE_ROWS, Pace, costs_of_rows
from . import blender_gpu as gpu
from . import cutouts, data_texture, samples, shader, target, unfinished
from .samples import Active
from .shader import Program

_OWNERS = ("RGBA32F", "FLOAT_2D", "low_nodes"), ("RGBA32F", "FLOAT_2D", "low_corners")
CLEARANCE = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/clearance_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=_OWNERS,
    constants=(*data_texture.tree_constants("low"), ("INT", "count"), ("INT", "per_row")),
    outputs=(("VEC4", "clearance_out"),),
    cost=4.0,
)
"""A fragment shader: of what a compute shader writes, Blender makes only textures and images wait, and this is read back."""
OWNER_TEXELS = 4
"""Texels of a triangle in Owners.corners."""
MOST_CLEARED = 2**16
"""The most triangles whose clearance is measured: with more, it takes longer than it saves."""
CLEARED_WIDTH, CLEARED_AT_ONCE = 256, 4
"""Texels a side of the target that they are written to, and of its blocks, as in shaders/bake/clearance_frag.glsl."""


@dataclass(frozen=True)
class Owners:
    """The triangles of a low mesh and a tree over them (bvh.Tree).

    Triangle i has four texels in `corners`. The first three have its corners, and the number of the triangle across the edge to
    the next corner, or -1. The fourth has its face normal, of any length, and its clearance: no triangle is closer to it than
    that, unless a short walk over the mesh leads to it.

    Attributes:
        room: Hits farther outside than this belong only to texels that are about at their closest point.
    """

    tree: data_texture.Tree
    corners: gpu.types.GPUTexture
    room: float

    @property
    def bindings(self) -> dict:
        """What a Program that looks for owners is bound to, beside `near`."""
        return {**self.tree.bindings("low"), "low_corners": self.corners}


def upload_owners(
    tree: data_texture.BuiltTree,
    corners: np.ndarray,
    neighbors: np.ndarray,
    room: float,
    *,
    has_clearances: bool = True,
) -> Owners:
    """Upload a tree (bvh.Tree), with corners (T, 3, 3) float32 and neighbors (T, 3) int in its order.

    has_clearances: whether the clearances are measured, which makes many searches for owners quicker; otherwise they are 0.
    """
    texels = np.zeros((len(corners), OWNER_TEXELS, 4), np.float32)
    texels[:, :3, :3], texels[:, :3, 3] = corners, neighbors
    texels[:, 3, :3] = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    uploaded = Owners(data_texture.upload_tree(tree), data_texture.upload(texels.reshape(-1, 4)), room)
    if not has_clearances or len(corners) > MOST_CLEARED:
        return uploaded
    texels[:, 3, 3] = _clearances(uploaded, len(corners))
    return replace(uploaded, corners=data_texture.upload(texels.reshape(-1, 4)))


def _clearances(owners: Owners, count: int) -> np.ndarray:
    """The clearances (T,) float32 of the triangles."""
    rows = -(-count // (CLEARED_AT_ONCE * CLEARED_WIDTH))
    into = target.Target(CLEARED_WIDTH, rows * CLEARED_AT_ONCE, ("R32F",))
    target.fill(
        into,
        CLEARANCE,
        **owners.bindings,
        count=count,
        per_row=CLEARED_WIDTH // CLEARED_AT_ONCE,
    )
    blocks = into.texels().reshape(rows, CLEARED_AT_ONCE, -1, CLEARED_AT_ONCE)
    return blocks.transpose(0, 2, 1, 3).reshape(-1)[:count]


_RAYS = ("FLOAT_2D", "positions"), ("FLOAT_2D", "directions")
_NODES = ("RGBA32F", "FLOAT_2D", "nodes")
_TRIANGLES = ("RGBA32F", "FLOAT_2D", "triangles")
_SEARCHED = _NODES, _TRIANGLES, ("RGBA32F", "FLOAT_2D", "points")
_PACKETS = ("UINT_2D", "packets")
_GRID = ("VEC4", "grid_origin"), ("VEC4", "grid_scale"), ("INT", "first_leaf")
_LIMITS = ("INT", "first_row"), ("FLOAT", "max_t"), ("FLOAT", "inside")
_HITS = (("RGBA32UI", "UINT_2D", "hits", "READ WRITE"), *unfinished.CARRIED)
PARTS_FIRST, PARTS_OWN = 2, 5
"""Texels of an unfinished ray: CAST_FIRST_PARTS in shaders/lib/cast_first_lib.glsl, CAST_PARTS in cast_lib.glsl."""
PACKETS = Program(
    compute="bake/packets_comp.glsl",
    texels=(*(("RGBA32F", *each) for each in _RAYS), _NODES),
    images=(("RGBA32UI", "UINT_2D", "packets", "WRITE"),),
    constants=(*_GRID, *_LIMITS),
)
TRACE_FIRST = Program(
    compute="bake/cast_first_comp.glsl",
    texels=_SEARCHED,
    samplers=(*_RAYS, _PACKETS, *samples.ACTIVE_SAMPLERS),
    images=_HITS,
    constants=(
        *_GRID,
        *_LIMITS,
        ("INT", "has_packets"),
        ("INT", "facing_only"),
        ("INT", "is_nearest"),
        *samples.ACTIVE_CONSTANTS,
    ),
    cost=0.5,
)
"""For the rules that need no owners. Software drivers run all of a shader for each texel, also what the texel does not need."""
TRACE = Program(
    compute="bake/cast_comp.glsl",
    texels=(*_SEARCHED, ("RGBA32F", "FLOAT_2D", "normals"), *_OWNERS),
    samplers=(*_RAYS, _PACKETS, *samples.ACTIVE_SAMPLERS),
    images=_HITS,
    constants=(
        *_GRID,
        *_LIMITS,
        ("INT", "has_packets"),
        ("INT", "facing_only"),
        *data_texture.tree_constants("low"),
        ("FLOAT", "near"),
        *samples.ACTIVE_CONSTANTS,
    ),
    cost=1.0,
)
TRACE_FIRST_LEFT = replace(TRACE_FIRST, compute="bake/cast_first_left_comp.glsl")
TRACE_LEFT = replace(TRACE, compute="bake/cast_left_comp.glsl")
"""They go on with rays that the others have left unfinished."""
TRACE_ORDERED = replace(TRACE, compute="bake/cast_ordered_comp.glsl", cost=3.0)
"""It goes on with its own rays."""
TRACE_FIRST_CUT, TRACE_FIRST_LEFT_CUT = cutouts.cutting(TRACE_FIRST), cutouts.cutting(TRACE_FIRST_LEFT)
TRACE_CUT, TRACE_LEFT_CUT = cutouts.cutting(TRACE), cutouts.cutting(TRACE_LEFT)
TRACE_ORDERED_CUT = cutouts.cutting(TRACE_ORDERED)
"""They let rays through where triangles are clear."""
LOOKUP = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/cast_lookup_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(
        ("RGBA32UI", "UINT_2D", "hits"),
        ("RGBA32F", "FLOAT_2D", "positions"),
        _TRIANGLES,
        ("RGBA32F", "FLOAT_2D", "normals"),
    ),
    constants=(("MAT4", "normal_matrix"),),
    outputs=(("VEC4", "normal_out"),),
    cost=0.1,
)
HEIGHT = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/cast_height_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "hits"), ("RGBA32F", "FLOAT_2D", "positions")),
    outputs=(("VEC4", "height_out"),),
)
POINTS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/cast_points_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(
        ("RGBA32UI", "UINT_2D", "hits"),
        ("RGBA32F", "FLOAT_2D", "surface_triangles"),
        ("RGBA32F", "FLOAT_2D", "surface_points"),
        ("RGBA32F", "FLOAT_2D", "labels"),
    ),
    outputs=(("VEC4", "point_out"), ("VEC4", "labels_out")),
    cost=0.1,
)
HIT_PARTS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/hit_parts_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32UI", "UINT_2D", "hits"),),
    outputs=(("VEC4", "hit_out"),),
)
PACKET_SIDE = 4
"""Texels along each side of a packet, as in shaders/lib/packet_lib.glsl."""
LEAST_PACKETS = 2**15
"""The fewest rays that pass the tree in packets: fewer are often rays of any places, as in an audit."""


@dataclass(frozen=True)
class Tables:
    """The triangles of the high meshes and their tree on the GPU.

    Triangle i has one texel in `triangles`: the numbers of its vertices in `points`, and where its normals are in `normals`, as
    shaders/lib/triangle_lib.glsl reads them. `cutouts` has where triangles are clear; None if none is.
    """

    tree: data_texture.Tree
    triangles: gpu.types.GPUTexture
    points: gpu.types.GPUTexture
    normals: gpu.types.GPUTexture
    cutouts: cutouts.Cutouts | None = None

    @property
    def triangle_bindings(self) -> dict:
        """What a program that looks for hits is bound to, beside the tree and the points."""
        return self.cutouts.bindings if self.cutouts else {"triangles": self.triangles}

    @property
    def bytes(self) -> int:
        """The GPU memory."""
        of_cutouts = self.cutouts.bytes if self.cutouts else 0
        return data_texture.size_of(self.tree.nodes, self.triangles, self.points, self.normals) + of_cutouts


@dataclass(frozen=True)
class Search:
    """Which hit of a ray counts, and where rays end.

    A ray runs against its direction, from its start to `inside` below the low surface, at most as far as `max_t`.

    Attributes:
        rule: OWN needs owners.
        facing_only: Ignore triangles whose back faces the ray.
        by_order: With OWN, match as many layers of the high meshes as the low mesh has along the ray by their order.
    """

    rule: Hit
    inside: float
    max_t: float
    facing_only: bool
    by_order: bool = False

    def programs(self, *, is_cut: bool) -> tuple[Program, Program]:
        """What casts the rays, and what goes on with those that it leaves. is_cut: whether triangles may be clear."""
        if self.rule != Hit.OWN:
            return (TRACE_FIRST_CUT, TRACE_FIRST_LEFT_CUT) if is_cut else (TRACE_FIRST, TRACE_FIRST_LEFT)
        if self.by_order:
            program = TRACE_ORDERED_CUT if is_cut else TRACE_ORDERED
            return program, program
        return (TRACE_CUT, TRACE_LEFT_CUT) if is_cut else (TRACE, TRACE_LEFT)


def upload(
    tree: data_texture.BuiltTree | data_texture.Tree,
    points: np.ndarray,
    vertices: np.ndarray,
    normals: np.ndarray,
    own_normals: np.ndarray,
    *,
    clear: cutouts.Records | None = None,
) -> Tables:
    """Upload a tree (bvh.Tree), unless it is on the GPU already, and its triangles.

    Args:
        vertices: (T, 3) int, indices into points (P, 3) float32, in the tree's order.
        normals: (N, 3) float32, of any length.
        own_normals: (T,) int, where the normals of each triangle are, in the tree's order: as shared_values.joined has it.
        clear: where triangles are clear, in the tree's order.
    """
    return Tables(
        tree if isinstance(tree, data_texture.Tree) else data_texture.upload_tree(tree),
        data_texture.upload_numbers(vertices, own_normals),
        data_texture.upload(points),
        data_texture.upload(normals),
        clear and cutouts.upload(clear, vertices, own_normals),
    )


def trace_in_slices(
    into: target.Target,
    rays: target.Target,
    tables: Tables,
    owners: Owners | None,
    search: Search,
    *,
    pace: Pace,
    some: Active | None = None,
    covered: np.ndarray | None = None,
) -> Iterator[range]:
    """As `trace`, in slices. Yields the rows that are done; with `some`, rows of its list.

    covered (N,): how many texels of each SLICE_ROWS rows have a ray, about; None for all.
    """
    height = some.rows if some else rays.height
    if covered is None or some:
        covered = np.full(-(-height // SLICE_ROWS), float(SLICE_ROWS * rays.width))
    program, _ = search.programs(is_cut=tables.cutouts is not None)

    def draw(rows: range) -> None:
        trace(into, rays, tables, owners, search, rows=rows, some=some)

    yield from pace.slices(
        f"{program.compute} some" if some else program.compute,
        costs_of_rows(covered, rays.width, program.cost),
        height,
        draw,
    )


def trace(
    into: target.Target,
    rays: target.Target,
    tables: Tables,
    owners: Owners | None,
    search: Search,
    *,
    rows: range | None = None,
    some: Active | None = None,
) -> None:
    """Trace one ray per texel and write its hit into `into` (RGBA32UI), as shaders/lib/hit_lib.glsl reads it, and wait.

    rays: what rays.draw wrote. rows: the rows to trace; the first is a multiple of 8. some: the texels to trace; `rows` are
    those of their list.
    """
    rows = rows or range(some.rows if some else rays.height)
    tree = tables.tree
    grid = {
        "grid_origin": (*tree.origin, 0.0),
        "grid_scale": (*tree.scale, 0.0),
        "first_leaf": tree.first_leaf,
        "nodes": tree.nodes,
    }
    limits = {
        "max_t": search.max_t,
        "inside": search.inside,
        "positions": rays.textures[0],
        "directions": rays.textures[1],
    }
    has_packets = some is None and rays.width * rays.height >= LEAST_PACKETS
    across, up = (-(-side // PACKET_SIDE) for side in (rays.width, rays.height))
    size = (2 * across, up) if has_packets else (2, 1)
    packets = target.get("packets" if has_packets else "no packets", *size, "RGBA32UI")
    if has_packets:
        blocks = range(rows.start // PACKET_SIDE, -(-rows.stop // PACKET_SIDE))
        target.dispatch(PACKETS, across, blocks, packets=packets.texture, **grid, **limits)
    searched = {
        "points": tables.points,
        "packets": packets.texture,
        "hits": into.texture,
        "has_packets": int(has_packets),
        "facing_only": int(search.facing_only),
        **samples.active_bindings(some, tree.nodes),
        **grid,
        **limits,
        **tables.triangle_bindings,
    }
    program, again = search.programs(is_cut=tables.cutouts is not None)
    if search.rule != Hit.OWN:
        is_nearest = int(search.rule == Hit.NEAREST)
        unfinished.dispatch(program, again, rays.width, rows, parts=PARTS_FIRST, is_nearest=is_nearest, **searched)
    elif owners is None:
        raise ValueError("the rule OWN needs owners")
    else:
        own = {"normals": tables.normals, "near": owners.room, **owners.bindings}
        unfinished.dispatch(program, again, rays.width, rows, parts=PARTS_OWN, **own, **searched)


def look_up(
    into: target.Target,
    hits: target.Target,
    rays: target.Target,
    tables: Tables,
    normal_matrix: np.ndarray,
    *,
    rows: range | None = None,
    some: Active | None = None,
) -> None:
    """Write the unit normals at the hits into `into` (RGBA32F). Alpha is 1 for a hit, -1 for a miss, 0 without a low mesh.

    normal_matrix: (3, 3), applied to the interpolated normal. rows: the rows to write. some: the texels to write; None for all.
    """
    target.fill(
        into,
        LOOKUP,
        rows=rows,
        stopped=some and some.stopped,
        hits=hits.texture,
        positions=rays.textures[0],
        triangles=tables.triangles,
        normals=tables.normals,
        normal_matrix=shader.mat4(normal_matrix),
    )


def heights(into: target.Target, hits: target.Target, rays: target.Target) -> None:
    """Write the height of each hit above the low surface into `into` (RGBA32F), negative below it.

    Green is 1 where the texel does not own its hit, blue where the ray hit only backs. Alpha is as in `look_up`.
    """
    target.fill(into, HEIGHT, hits=hits.texture, positions=rays.textures[0])


def read_hits(hits: target.Target) -> tuple[np.ndarray, np.ndarray]:
    """The triangles (rows, columns) int32 of hits, in the tree's order and -1 for a miss, and two barycentric coordinates
    (rows, columns, 2) float32, as hit_weights has them."""
    drawn = target.Target(hits.width, hits.height, ("RGBA32F",))
    target.fill(drawn, HIT_PARTS, hits=hits.texture)
    parts = drawn.texels()
    return parts[..., 2].astype(np.int32) + (parts[..., 3].astype(np.int32) << 14) - 1, parts[..., :2]


def points(into: target.Target, hits: target.Target, tables: Tables, labels: gpu.types.GPUTexture) -> None:
    """Write the hit points and their labels into `into` (two RGBA32F). Alpha is 1 for a hit, 0 for a miss.

    labels: a data texture with the object and material number of each triangle, in the tree's order.
    """
    target.fill(
        into,
        POINTS,
        clear=True,
        hits=hits.texture,
        surface_triangles=tables.triangles,
        surface_points=tables.points,
        labels=labels,
    )
