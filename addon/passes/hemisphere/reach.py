# SPDX-License-Identifier: GPL-3.0-or-later
"""What the passes that cast many rays from each hit have in common: declarations, and bindings of the tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import target
from ..program import Program

if TYPE_CHECKING:
    import gpu

    from ..bake import cast
    from .lattice import Lattice

TEXELS = (
    ("RGBA32UI", "UINT_2D", "hits"),
    ("RGBA32F", "FLOAT_2D", "surface_triangles"),
    ("RGBA32F", "FLOAT_2D", "surface_points"),
    ("RGBA32F", "FLOAT_2D", "nodes"),
    ("RGBA32F", "FLOAT_2D", "triangles"),
    ("RGBA32F", "FLOAT_2D", "points"),
)
NORMALS = (("RGBA32F", "FLOAT_2D", "surface_normals"),)
SUMS = (("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),)
CONSTANTS = (
    ("VEC4", "grid_origin"),
    ("VEC4", "grid_scale"),
    ("VEC4", "steps"),
    ("VEC4", "cell"),
    ("IVEC4", "numbers"),
    ("INT", "first_row"),
    ("INT", "first_leaf"),
)
"""`numbers` has the first ray, the count of rays, the step from a ray to the next, and 1 to replace the sums. Fourth numbers,
since there are only 128 bytes: `grid_scale` has where rays end, `grid_origin` one that is free, `steps` the cone."""
MEAN = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="hemisphere/mean_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "sums"), ("RGBA32F", "FLOAT_2D", "normals")),
    constants=(("VEC4", "factors"), ("FLOAT", "base"), ("FLOAT", "lowest"), ("FLOAT", "rays")),
    outputs=(("VEC4", "value_out"),),
)
UNBOUNDED = -1e30


def add(
    program: Program,
    sums: target.Target,
    hits: gpu.types.GPUTexture,
    surface: cast.Tables,
    occluders: cast.Tables,
    *,
    lattice: Lattice,
    rays: range,
    rows: range,
    is_first: bool,
    farthest: float,
    cone: float = 1.0,
    free: float = 0.0,
    **bindings,
) -> None:
    """Run a compute shader that adds these rays to `sums` (RGBA32F) in these rows; the first row is a multiple of 8.

    hits: RGBA32UI, as shaders/lib/hit_lib.glsl reads it, with triangles of `surface`. occluders: what rays meet. is_first:
    replace the sums. farthest: where rays end, in the occluders' space. cone: the square of the sine of the largest angle to
    the axis. free: the number in `grid_origin`.
    """
    target.dispatch(
        program,
        sums.width,
        rows,
        hits=hits,
        surface_triangles=surface.triangles,
        surface_points=surface.points,
        nodes=occluders.nodes,
        triangles=occluders.triangles,
        points=occluders.points,
        sums=sums.texture,
        grid_origin=(*occluders.origin, free),
        grid_scale=(*occluders.scale, farthest),
        steps=(*lattice.step, lattice.count, cone),
        cell=lattice.cell,
        numbers=(rays.start, len(rays), rays.step, int(is_first)),
        first_leaf=occluders.first_leaf,
        **bindings,
    )


def mean(
    into: target.Target,
    sums: target.Target,
    normals: gpu.types.GPUTexture,
    rays: int,
    *,
    factors: tuple[float, float, float, float],
    base: float = 0.0,
    lowest: float = UNBOUNDED,
) -> None:
    """Write base + dot(factors, sums / number of rays), at least `lowest`, into `into` (RGBA32F).

    normals: of one sample (alpha 1 hit, 0 empty, -1 missed), or the sums of several that samples.add wrote, if `sums` has the
    rays of all of them. rays: of each sample. Alpha of `into` is 1 known, 0 empty, -1 missed.
    """
    target.fill(
        into,
        MEAN,
        sums=sums.texture,
        normals=normals,
        factors=factors,
        base=base,
        lowest=lowest,
        rays=float(rays),
    )
