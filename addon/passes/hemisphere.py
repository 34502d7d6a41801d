# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts many rays from each hit: ambient occlusion with bent normals, thickness, and curvature.

Each has a function that adds rays to sums, and `Value`s that these sums make. All rays of a texel are points of one lattice.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..core.progress import Pace, costs_of_rows
from . import blender_gpu as gpu
from . import cast, cutouts, shader, target, unfinished
from .shader import Program

_SAMPLERS = (("UINT_2D", "hits"),)
"""No texels, which would be one image more than OpenGL has to have."""
_TEXELS = (
    ("RGBA32F", "FLOAT_2D", "surface_triangles"),
    ("RGBA32F", "FLOAT_2D", "surface_points"),
    ("RGBA32F", "FLOAT_2D", "nodes"),
    ("RGBA32F", "FLOAT_2D", "triangles"),
    ("RGBA32F", "FLOAT_2D", "points"),
    ("RGBA32F", "FLOAT_2D", "surface_normals"),
)
_SUMS = (("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"), *unfinished.CARRIED)
PARTS = 3
"""Texels of unfinished rays: SUMS_PARTS in shaders/lib/sums_lib.glsl."""
_CONSTANTS = (
    ("VEC4", "grid_origin"),
    ("VEC4", "grid_scale"),
    ("VEC4", "steps"),
    ("VEC4", "cell"),
    ("IVEC4", "numbers"),
    ("INT", "first_row"),
    ("INT", "first_leaf"),
)
"""`numbers` has the first ray, the count of rays, the step from a ray to the next, and 1 to replace the sums plus twice the row
of Rays.first_row. Fourth numbers, since there are only 128 bytes: `grid_scale` has where rays end, `grid_origin` one that is
free, `steps` the cone."""
ADD_OPENNESS = Program(
    compute="hemisphere/openness_comp.glsl",
    samplers=_SAMPLERS,
    texels=_TEXELS,
    images=_SUMS,
    constants=(("VEC4", "placed"), ("IVEC4", "blocking"), *_CONSTANTS),
    cost=0.5,
)
"""Its cost, and those of the next two, are of one ray of a texel."""
_SHARED: dict = {"samplers": _SAMPLERS, "texels": _TEXELS, "images": _SUMS, "constants": _CONSTANTS}
ADD_THICKNESS = Program(compute="hemisphere/thickness_comp.glsl", cost=0.5, **_SHARED)
ADD_CURVATURE = Program(compute="hemisphere/curvature_comp.glsl", cost=1.0, **_SHARED)
ADD_OPENNESS_CUT, ADD_THICKNESS_CUT = cutouts.cutting(ADD_OPENNESS), cutouts.cutting(ADD_THICKNESS)
ADD_CURVATURE_CUT = cutouts.cutting(ADD_CURVATURE)
_CUT = {ADD_OPENNESS: ADD_OPENNESS_CUT, ADD_THICKNESS: ADD_THICKNESS_CUT, ADD_CURVATURE: ADD_CURVATURE_CUT}
"""What lets rays through where triangles are clear."""
MEAN = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="hemisphere/mean_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "sums"), ("RGBA32F", "FLOAT_2D", "normals")),
    constants=(("VEC4", "factors"), ("FLOAT", "base"), ("FLOAT", "lowest"), ("FLOAT", "rays")),
    outputs=(("VEC4", "value_out"),),
)
BENT_NORMAL = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="hemisphere/bent_normal_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "sums"), ("RGBA32F", "FLOAT_2D", "normals")),
    constants=(("MAT4", "normal_matrix"), ("FLOAT", "rays"), ("INT", "is_unit")),
    outputs=(("VEC4", "value_out"),),
)
FADES = ("NONE", "LINEAR", "SMOOTH")
"""How blocked directions become visible with the distance of what blocks them, by the numbers in openness_comp.glsl."""
UNLIMITED = 1e8
"""The length of rays without a limit, in local space."""
FRONTS, BOTH = 1, 3
"""The sides of triangles that block, as in shaders/lib/reach_lib.glsl."""
NO_FLOOR = -1e30
SHIFTS = 64
"""As LATTICE_SIDE in shaders/lib/lattice_lib.glsl."""
IN_A_PART = 64
"""The most rays of a texel that follow each other in the order of the lattice: parts are spread over all directions."""
AT_ONCE = 64
"""The most rays of a texel in one dispatch: large maps take rows of few texels otherwise. No map depends on it."""
TOGETHER = 4
"""Rays that pass the tree together: REACH_RAYS in shaders/lib/reach_lib.glsl."""


@dataclass(frozen=True)
class Lattice:
    """A lattice of rank 1: point i is at (i * step[0] / count, i * step[1] / count), without the whole parts.

    Attributes:
        step: The way from a point to the next, a short one, so that successive rays take similar ways.
        cell: The two shortest vectors of the lattice, as (x0, y0, x1, y1).
    """

    count: int
    step: tuple[int, int]
    cell: tuple[float, float, float, float]


@functools.cache
def lattice_of(count: int) -> Lattice:
    """The lattice of `count` points that integrates smooth functions best."""
    generators = (a for a in range(1, max(2, count // 2 + 1)) if math.gcd(a, count) == 1)
    chosen = min(generators, key=lambda a: _error(count, a))
    short, long = _reduced((1, chosen), (0, count))
    sums = [(short[0] * i + long[0] * j, short[1] * i + long[1] * j) for i in range(4) for j in range(-3, 4)]
    # Not every short step leads through all points.
    step = min((way for way in [*sums, (1, chosen)] if math.gcd(*way, count) == 1), key=lambda way: math.hypot(*way))
    return Lattice(
        count,
        (step[0] % count, step[1] % count),
        (short[0] / count, short[1] / count, long[0] / count, long[1] / count),
    )


def rays_of_sample(lattice: Lattice, sample: int, samples: int) -> range:
    """The rays that one of several samples in a texel casts: every texel casts all rays of the lattice once."""
    return range(sample, lattice.count, samples)


def slices(
    pace: Pace,
    program: Program,
    size: tuple[int, int],
    covered: np.ndarray,
    rays: range,
    *,
    draw: Callable[[range, range, bool], None],
) -> Iterator[tuple[range, range, bool]]:
    """Cast rays from a map of `size` in slices of rows, as Pace does: yields what `draw` got, after it.

    The rays of a part are spread over all directions, so that sums can be shown before they are complete.

    Args:
        program: that casts the rays.
        covered: (N,), how many texels of each SLICE_ROWS rows cast rays, about.
        draw: gets rows, rays, and whether these are the first rays of the rows. It waits for the GPU.
    """
    parts = -(-len(rays) // IN_A_PART)
    at_once = max(TOGETHER, AT_ONCE // TOGETHER * TOGETHER)
    for part, first in itertools.product(range(parts), range(0, IN_A_PART, at_once)):
        some, is_first = rays[part::parts][first : first + at_once], part == first == 0
        if not some:
            continue
        costs = costs_of_rows(covered, size[0], program.cost * len(some))

        def draw_some(rows: range, some: range = some, is_first: bool = is_first) -> None:
            draw(rows, some, is_first)

        for rows in pace.slices(program.compute, costs, size[1], draw_some):
            yield rows, some, is_first


def _in_ended_part(lattice: Lattice, numbers: range) -> int:
    """How many rays the part has that ends with these rays of a dispatch, or 0 if further dispatches have the rest of it."""
    if numbers[-1] + numbers.step < lattice.count:
        return 0
    return len(range(numbers.start % numbers.step, lattice.count, numbers.step))


@dataclass(frozen=True)
class Rays:
    """Rays from the hits of one sample.

    Attributes:
        hits: RGBA32UI, as shaders/lib/hit_lib.glsl reads it, with triangles of `surface`.
        numbers: The points of the lattice.
        rows: Those of the texture; the first is a multiple of 8.
        is_first: Whether they replace what the sums hold.
        first_row: The row of the map that is the texture's first: a band takes the rays that the whole map takes.
    """

    hits: gpu.types.GPUTexture
    surface: cast.Tables
    lattice: Lattice
    numbers: range
    rows: range
    is_first: bool
    first_row: int = 0


@dataclass(frozen=True)
class Occluders:
    """What blocks rays, and how.

    Attributes:
        tables: The triangles; None for those of the surface itself.
        scale, offset: What takes a point of the surface's space to that of `tables`: point * scale + offset; the axes are the
            same.
        farthest: Rays end here; None for no limit.
        fade: One of FADES; with a limit only.
        two_sided: Backs block too.
        bias: Directions within this angle of the tangent plane are left out, in radians.
        floor: The height z of a plane that blocks rays from above; None for no floor. Lengths are in the surface's space.
        from_inside: Rays from an edge start a little inside of their triangle, as the texels of a mesh onto itself often are.
    """

    tables: cast.Tables | None = None
    scale: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    farthest: float | None = None
    fade: str = "NONE"
    two_sided: bool = False
    bias: float = 0.0
    floor: float | None = None
    from_inside: bool = False


@dataclass(frozen=True)
class Value:
    """What `mean` writes: base + dot(factors, sums / number of rays), at least `lowest`."""

    factors: tuple[float, float, float, float]
    base: float = 0.0
    lowest: float = -1e30


OCCLUSION = Value((0.0, 0.0, 0.0, 1.0))
"""Of `add_openness`: 0 all blocked, 1 all visible."""
THICKNESS = Value((1.0, 0.0, 0.0, 0.0))
"""Of `add_thickness`: 0 thin, 1 at least `farthest` in all directions."""
CURVATURE = Value((1.0, -1.0, 0.0, 0.0), base=0.5)
"""Of `add_curvature`: 0.5 flat, above it convex, below it concave."""
CONVEXITY = Value((2.0, -2.0, 0.0, 0.0), lowest=0.0)
"""max(0, 2 * curvature - 1): 1 on a convex edge of 90 degrees."""
CAVITY = Value((-2.0, 2.0, 0.0, 0.0), lowest=0.0)
"""max(0, 1 - 2 * curvature): 1 on a concave edge of 90 degrees."""


def add_openness(sums: target.Target, rays: Rays, occluders: Occluders) -> None:
    """Add rays to `sums` (RGBA32F): xyz has the sum of the visible directions, w of their visibility.

    With the unit normal n and the visibility V(w) of a direction w, 0 to 1:
    ambient occlusion = 1 / pi * integral over the hemisphere around n of V(w) dot(n, w) dw,
    and the bent normal is the mean of V(w) w. Rays are distributed as dot(n, w), so that both are means over rays.
    Directions have world axes, as the tables do.
    """
    farthest = UNLIMITED if occluders.farthest is None else occluders.farthest * occluders.scale
    _add(
        ADD_OPENNESS,
        sums,
        rays,
        occluders.tables or rays.surface,
        cone=math.cos(occluders.bias) ** 2,
        farthest=farthest,
        free=NO_FLOOR if occluders.floor is None else occluders.floor * occluders.scale + occluders.offset[2],
        placed=(*occluders.offset, occluders.scale),
        blocking=(
            0 if occluders.farthest is None else FADES.index(occluders.fade),
            BOTH if occluders.two_sided else FRONTS,
            int(occluders.tables is None) + 2 * int(occluders.from_inside),
            _in_ended_part(rays.lattice, rays.numbers),
        ),
    )


def add_thickness(sums: target.Target, rays: Rays, farthest: float) -> None:
    """Add rays to `sums` (RGBA32F): x has the sum of their lengths inside the solid, as shares of `farthest`, at most 1.

    farthest: in local space. Rays are distributed as the cosine to the inward normal; they end at the first triangle that they
    meet from behind.
    """
    _add(ADD_THICKNESS, sums, rays, rays.surface, farthest=farthest)


def add_curvature(sums: target.Target, rays: Rays, radius: float) -> None:
    """Add pairs of rays to `sums` (RGBA32F): x has the sum of what the inner half of a ball lacks, y of what the outer holds.

    radius: of the ball around the point, in local space. The share of the ball that is inside the solid is the measure:
    H. Pottmann and others, "Integral invariants for robust geometry processing" (2009). With the radius R of the ball, the
    length s of a ray into the solid until it leaves it, and the length t of a ray outwards until it enters again, the share is
    f = 1/2 * (mean of min(s, R)^3 / R^3 + mean of 1 - min(t, R)^3 / R^3), over all directions of each half of the ball.
    On a sphere of radius r, f = 1/2 - 3 R / (16 r). The value is 1/2 + 2 * (1/2 - f): 0.5 on a plane, 1 on a convex edge of 90
    degrees, 0 on a concave one.
    """
    _add(ADD_CURVATURE, sums, rays, rays.surface, farthest=radius)


def mean_curvature_scale(radius: float) -> float:
    """The factor on (curvature - 0.5) that gives the mean curvature H, in 1 / the unit of `radius`, on smooth surfaces."""
    return 8.0 / 3.0 / radius


def mean(into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, rays: float, value: Value) -> None:
    """Write a value of the rays in `sums` into `into` (RGBA32F). Alpha is 1 known, 0 empty, -1 missed.

    normals: of one sample (alpha 1 hit, 0 empty, -1 missed), or the sums of several that samples.add wrote, if `sums` has the
    rays of all of them. rays: of each sample.
    """
    target.fill(
        into,
        MEAN,
        sums=sums.texture,
        normals=normals,
        factors=value.factors,
        base=value.base,
        lowest=value.lowest,
        rays=float(rays),
    )


def bent_normals(
    into: target.Target,
    sums: target.Target,
    normals: gpu.types.GPUTexture,
    rays: float,
    normal_matrix: np.ndarray,
    *,
    is_unit: bool = False,
) -> None:
    """Write the mean visible directions into `into` (RGBA32F), shorter than 1, or normalized. Otherwise as `mean`.

    normal_matrix: (3, 3), applied to the directions, as in cast.look_up. Where all is blocked, the value has the direction of
    the high surface's normal and, without is_unit, a length of about 0.
    """
    target.fill(
        into,
        BENT_NORMAL,
        sums=sums.texture,
        normals=normals,
        normal_matrix=shader.mat4(normal_matrix),
        rays=float(rays),
        is_unit=int(is_unit),
    )


def _add(
    program: Program,
    sums: target.Target,
    rays: Rays,
    occluders: cast.Tables,
    *,
    farthest: float,
    cone: float = 1.0,
    free: float = 0.0,
    **bindings,
) -> None:
    """Run a compute shader that adds rays to `sums`. Waits for the GPU.

    occluders: what rays meet. farthest: where rays end, in the occluders' space. cone: the square of the sine of the largest
    angle to the axis. free: the number in `grid_origin`.
    """
    surface, lattice, numbers, tree = rays.surface, rays.lattice, rays.numbers, occluders.tree
    if occluders.cutouts is not None:
        program = _CUT[program]
    unfinished.dispatch(
        program,
        program,
        sums.width,
        rays.rows,
        parts=PARTS,
        hits=rays.hits,
        surface_triangles=surface.triangles,
        surface_points=surface.points,
        surface_normals=surface.normals,
        nodes=tree.nodes,
        points=occluders.points,
        sums=sums.texture,
        grid_origin=(*tree.origin, free),
        grid_scale=(*tree.scale, farthest),
        steps=(*lattice.step, lattice.count, cone),
        cell=lattice.cell,
        numbers=(numbers.start, len(numbers), numbers.step, rays.first_row % SHIFTS * 2 + rays.is_first),
        first_leaf=tree.first_leaf,
        **occluders.triangle_bindings,
        **bindings,
    )


def _reduced(first: tuple[int, int], second: tuple[int, int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The two shortest vectors of the lattice that these two span, the shortest first (Gauss's reduction)."""
    while True:
        if math.hypot(*first) > math.hypot(*second):
            first, second = second, first
        times = round((first[0] * second[0] + first[1] * second[1]) / (first[0] ** 2 + first[1] ** 2))
        if times == 0:
            return first, second
        second = second[0] - times * first[0], second[1] - times * first[1]


def _error(count: int, generator: int) -> float:
    """The figure of merit P2 of a lattice (I. H. Sloan and S. Joe, "Lattice methods for multiple integration", 1994)."""
    x = np.arange(count)
    u, v = x / count, x * generator % count / count
    waves = [1.0 + 2.0 * np.pi**2 * (w * w - w + 1.0 / 6.0) for w in (u, v)]
    return float(np.mean(waves[0] * waves[1])) - 1.0
