# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of texels: where they lie, how many each texel takes, their means, and passes that run on some texels alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import blender_gpu as gpu
from . import data_texture, target
from .shader import Program

# All sums of samples have one format and one shader: in Mesa 26.2, zink may give a compute shader the textures of the last
# drawing, where compute shaders with other numbers of images take turns on one texture.
ADD = Program(
    compute="bake/accumulate_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), ("INT", "is_first")),
)
AVERAGE = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/average_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "sums"),),
    constants=(("INT", "is_direction"),),
    outputs=(("VEC4", "normal_out"),),
)


ROUND_ENDS = (2, 4, 8, 16)
"""How many samples a texel has after the rounds of adaptive samples; the last one takes all."""
UNEVEN = {(4, 8)}
"""Rounds that are left out: no four of the eight samples are spread as evenly in both directions."""
BEND = 4.0
"""How much bends count, compared with steps: most edges of a smooth mesh are bends."""
_EIGHT = (3, 6, 0, 5, 2, 7, 1, 4)
"""The order of eight rows that averages waves in any direction most accurately, found among all orders."""


def offsets(count: int) -> list[tuple[float, float]]:
    """The positions of `count` samples, one of core.settings.SAMPLES, in a texel, from its center, in texels.

    No two samples share one of the `count` rows or columns. A single sample is at the center. More samples are the
    Hammersley set. Each bit of its numbers shifts samples towards the diagonal by the same amount, so half of the bits of
    one coordinate are inverted to cancel this. Eight samples have three bits, an odd number, and use an order of their own.
    """
    bits = count.bit_length() - 1
    upright = (1 << bits // 2) - 1
    rows = _EIGHT if count == 8 else [int(f"0{i:0{bits}b}"[:0:-1], 2) ^ upright if bits else 0 for i in range(count)]
    return [((i + 0.5) / count - 0.5, (row + 0.5) / count - 0.5) for i, row in enumerate(rows)]


def rounds(count: int) -> list[list[tuple[float, float]]]:
    """The `offsets` of 4 samples or more in the rounds in which adaptive samples take them, with ROUNDS in all.

    The samples of a round come in pairs that lie opposite to each other around the center: their mean is exact for values that
    change linearly. The first pair, and the first two together, are closest to the mean of all samples, for edges in any
    direction, between two values and between two slopes. So is each further pair, with those before it.
    """
    places = offsets(count)
    pairs = _edges(np.array(places))
    pairs = pairs[: count // 2] + pairs[: count // 2 - 1 : -1]
    alone = np.square(pairs).sum(axis=1) / 4.0
    errors = np.square(pairs[:, None] + pairs).sum(axis=2) / 16.0 + alone[:, None]
    np.fill_diagonal(errors, np.inf)
    order = list(np.unravel_index(errors.argmin(), errors.shape))
    while len(order) < len(pairs):
        errors = np.square(pairs[order].sum(axis=0) + pairs).sum(axis=1)
        errors[order] = np.inf
        order.append(errors.argmin())
    order = [i for pair in order for i in (pair, count - 1 - pair)]
    stops = [stop for stop in ROUND_ENDS if stop < count and (stop, count) not in UNEVEN] + [count]
    return [[places[i] for i in order[start:stop]] for start, stop in zip([0, *stops], stops, strict=False)]


def _edges(places: np.ndarray) -> np.ndarray:
    """Steps and bends along lines in many places and directions at places (N, 2), less their means over all: (N, E)."""
    turns = np.linspace(0.0, np.pi, 16, endpoint=False)
    across = places @ np.stack([np.cos(turns), np.sin(turns)])
    beyond = (across[:, :, None] - np.linspace(-0.6, 0.6, 25)).reshape(len(places), -1)
    values = np.concatenate([beyond > 0.0, np.maximum(beyond, 0.0) * BEND], axis=1)
    return values - values.mean(axis=0)


def add(sums: target.Target, normals: gpu.types.GPUTexture, rows: range, *, is_first: bool) -> None:
    """Add `normals` (RGBA32F; alpha 1 hit, 0 empty, -1 missed) to `sums` (RGBA32F) in these rows. is_first: replace them."""
    target.dispatch(ADD, sums.width, rows, normals=normals, sums=sums.texture, is_first=int(is_first))


def average(into: target.Target, sums: target.Target, *, is_direction: bool = True) -> None:
    """Write the means of `sums` into `into` (RGBA32F), in the form of a single sample; directions are normalized again."""
    target.fill(into, AVERAGE, sums=sums.texture, is_direction=int(is_direction))


STOPPED = Program(
    vertex="lib/nearer_vert.glsl",
    fragment="adaptive/stopped_frag.glsl",
    inputs=(("VEC2", "position"),),
    samplers=(("FLOAT_2D", "rounds"), ("FLOAT_2D", "covered")),
    constants=(("FLOAT", "number"), ("INT", "covered_side")),
    outputs=(("FLOAT", "nothing_out"),),
)
NOTHING = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="adaptive/nothing_frag.glsl",
    inputs=(("VEC2", "position"),),
    outputs=(("VEC4", "nothing_out"),),
)
ACTIVE_SAMPLERS = (("FLOAT_2D", "active_texels"),)
ACTIVE_CONSTANTS = (("INT", "active_count"),)
"""What a Program declares that takes its texels with shaders/lib/active_lib.glsl."""
GROUP_SIDE = 8
"""The side of a workgroup, as in active_lib.glsl."""
COVERED = 4
"""The side of the squares in which empty texels can be left out."""


@dataclass(frozen=True)
class Active:
    """Some texels of a map.

    Attributes:
        stopped: Depth, in which all other texels are drawn.
        texels: The list.
        count: Its length.
        rows: Of workgroups as wide as the map, times their side, that work on the list.
        blocks (rows, columns) bool: Which squares of GROUP_SIDE texels have some of them.
    """

    stopped: gpu.types.GPUTexture
    texels: gpu.types.GPUTexture
    count: int
    rows: int
    blocks: np.ndarray


def clear_active(into: target.Target, some: Active) -> None:
    """Set these texels of the first texture of `into` (RGBA32F) to 0. Clearing all of it takes longer than to draw few."""
    only = target.Target.of(into.width, into.height, into.formats[0], into.textures[0])
    target.fill(only, NOTHING, stopped=some.stopped)


def upload_covered(covered: np.ndarray) -> gpu.types.GPUTexture:
    """Squares (rows, columns) bool of COVERED texels, as `find` takes them."""
    return data_texture.image(covered, "R8")


def find_active(
    rounds: gpu.types.GPUTexture, needed: np.ndarray, number: int, covered: gpu.types.GPUTexture | None = None
) -> Active | None:
    """The texels that take samples in round `number`, counted from 1; None if there are none. Valid until the next call.

    rounds: what rounds.draw wrote. needed: the same (height, width) uint8, less what `covered` leaves out. covered: from
    `upload_covered`: empty texels outside of these squares take no more samples; None if there are none.
    """
    height, width = needed.shape
    listed, blocks = in_blocks(needed >= number)
    if not len(listed):
        return None
    pairs = np.zeros((-(-len(listed) // 2) * 2, 2), np.float32)
    pairs[: len(listed)] = listed
    groups, across = -(-len(listed) // GROUP_SIDE**2), -(-width // GROUP_SIDE)
    bound = {"rounds": rounds, "number": float(number), "covered": covered or rounds, "covered_side": COVERED}
    depth = target.get("stopped texels", width, height, "R8", "DEPTH_COMPONENT32F")
    target.fill(depth, STOPPED, clear=True, writes_depth=True, **bound)
    texels = data_texture.upload(pairs.reshape(-1, 4))
    return Active(depth.textures[1], texels, len(listed), -(-groups // across) * GROUP_SIDE, blocks)


def active_bindings(some: Active | None, unused: gpu.types.GPUTexture) -> dict:
    """What a Program with SAMPLERS and CONSTANTS is bound to. some: None for all texels; then `unused` is any texture."""
    return {"active_texels": some.texels if some else unused, "active_count": some.count if some else -1}


def in_blocks(is_active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The places (N, 2) int of the texels, x and y, square by square: texels of a workgroup are close to each other. And which
    squares have some, as Active has them."""
    height, width = is_active.shape
    across, up = -(-width // GROUP_SIDE), -(-height // GROUP_SIDE)
    padded = is_active
    if (up * GROUP_SIDE, across * GROUP_SIDE) != (height, width):
        padded = np.zeros((up * GROUP_SIDE, across * GROUP_SIDE), bool)
        padded[:height, :width] = is_active
    ordered = padded.reshape(up, GROUP_SIDE, across, GROUP_SIDE).transpose(0, 2, 1, 3)
    lanes = np.flatnonzero(ordered)
    blocks = np.zeros(up * across, bool)
    block, inner = np.divmod(lanes, GROUP_SIDE**2)
    y, x = np.divmod(block, across)
    blocks[block] = True
    places = np.stack([x * GROUP_SIDE + inner % GROUP_SIDE, y * GROUP_SIDE + inner // GROUP_SIDE], axis=1)
    return places, blocks.reshape(up, across)


COUNT_ROUNDS = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="adaptive/rounds_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "one"), ("RGBA32F", "FLOAT_2D", "other")),
    constants=(("VEC4", "limits"), ("VEC2", "separation"), ("FLOAT", "most")),
    outputs=(("FLOAT", "rounds_out"), ("VEC4", "sum_out")),
)
ADD_SAMPLE = Program(
    compute="adaptive/add_active_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    samplers=ACTIVE_SAMPLERS,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), *ACTIVE_CONSTANTS),
)
AVERAGE_SAMPLES = Program(
    compute="adaptive/average_active_comp.glsl",
    samplers=ACTIVE_SAMPLERS,
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), *ACTIVE_CONSTANTS),
)
UNLIMITED = 1e30
EMPTY = 255
"""In place of rounds, as in rounds_frag.glsl and stopped_frag.glsl."""
ROUND_FORMATS = "R8", "RGBA32F"
"""Of the target of `draw_rounds`."""


def draw_rounds(
    into: target.Target,
    one: gpu.types.GPUTexture,
    other: gpu.types.GPUTexture,
    *,
    offset: tuple[float, float],
    limits: Sequence[float],
) -> np.ndarray:
    """Write into `into` (ROUND_FORMATS) how many rounds each texel takes part in, and its mean or its sum.

    Returns the rounds (height, width) uint8, EMPTY where both samples found nothing.

    one, other: normals (RGBA32F; alpha 1 hit, 0 empty, -1 missed) of the two samples of the first round. offset: of `one` from
    the center, in texels; the other one is opposite. limits: in degrees, for each round but the last one.

    A texel ends with the first round whose limit is not below its bend: the largest second difference, along a row or a column,
    of the means of both samples, or twice what they differ beyond the slope of these means. It takes part in all rounds where
    not all these samples hit: at borders, and where nothing is known yet. So do EMPTY texels, but for those that
    find_active leaves out.
    """
    squared = [(2.0 * math.radians(limit)) ** 2 for limit in limits]  # sums of two samples are compared
    target.fill(
        into,
        COUNT_ROUNDS,
        one=one,
        other=other,
        limits=(*squared, *[UNLIMITED] * (4 - len(squared))),
        separation=(2.0 * offset[0], 2.0 * offset[1]),
        most=float(len(limits) + 1),
    )
    return into.texels()


def add_sample(sums: gpu.types.GPUTexture, normals: gpu.types.GPUTexture, some: Active) -> None:
    """Add one more sample of some texels to their sums, the second texture of `draw_rounds`."""
    target.dispatch(
        ADD_SAMPLE, normals.width, range(some.rows), sums=sums, normals=normals, **active_bindings(some, normals)
    )


def average_samples(sums: gpu.types.GPUTexture, some: Active) -> None:
    """Replace the sums of some texels by their means, as a single sample has them."""
    target.dispatch(AVERAGE_SAMPLES, sums.width, range(some.rows), sums=sums, **active_bindings(some, sums))


ADD_SLOPES = Program(
    compute="surface/slope_moments_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "normals"), ("RGBA32F", "FLOAT_2D", "directions")),
    images=(("RGBA32F", "FLOAT_2D", "squares", "READ WRITE"), ("RGBA32F", "FLOAT_2D", "products", "READ WRITE")),
    constants=(("INT", "first_row"), ("INT", "is_first"), ("INT", "has_directions")),
)
WIDEN = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="surface/widened_roughness_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(
        ("RGBA32F", "FLOAT_2D", "normals"),
        ("RGBA32F", "FLOAT_2D", "squares"),
        ("RGBA32F", "FLOAT_2D", "products"),
        ("RGBA32F", "FLOAT_2D", "roughness"),
    ),
    outputs=(("VEC4", "value_out"),),
)


def add_slopes(
    sums: target.Target,
    normals: gpu.types.GPUTexture,
    directions: gpu.types.GPUTexture | None,
    *,
    is_first: bool,
) -> None:
    """Add one sample of each texel to the second moments in `sums` (two RGBA32F): x x, y y, z z, count; x y, y z, z x.

    They are those of the unit `normals` (RGBA32F; alpha 1 hit, 0 empty, -1 missed), stretched to a height of 1 above the low
    surface, so that x and y of tangent space are slopes. directions: the low surface's normals in their space (RGBA32F); None
    for tangent space. is_first: replace what the sums held.
    """
    target.dispatch(
        ADD_SLOPES,
        sums.width,
        range(sums.height),
        normals=normals,
        directions=directions or normals,
        squares=sums.textures[0],
        products=sums.textures[1],
        is_first=int(is_first),
        has_directions=int(directions is not None),
    )


def widen_roughness(
    into: target.Target, sums: target.Target, normals: gpu.types.GPUTexture, roughness: gpu.types.GPUTexture
) -> None:
    """Write perceptual roughness into `into` (RGBA32F; alpha 1 known, 0 empty, -1 missed), the same in three channels.

    alpha' ^ 2 = alpha ^ 2 + the variances of both slopes, where alpha is the square of `roughness` (RGBA32F), and slopes are
    those against the mean normal. sums: of `add`. normals: the only sample, or the sum of all.
    """
    target.fill(into, WIDEN, normals=normals, squares=sums.textures[0], products=sums.textures[1], roughness=roughness)
