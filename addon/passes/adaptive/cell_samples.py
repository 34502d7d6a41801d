# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes all further samples of some texels in one pass, of meshes whose triangles are sorted into cells. Nothing is drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.udim import UvToClip
from .. import blender_gpu as gpu
from .. import data_texture, target
from ..program import Program
from .active import BLOCK

PROGRAM = Program(
    compute="adaptive/cell_samples_comp.glsl",
    texels=tuple(("RGBA32F", "FLOAT_2D", name) for name in ("listed", "cells", "offsets", "highs", "lows")),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(
        ("IVEC4", "listing"),
        *(("INT", name) for name in ("first_sample", "end_sample", "cell_side", "is_turned", "basis_flags")),
        ("VEC2", "uv_to_clip_scale"),
    ),
)
STEP = 2**24
"""The triangles after which a step ends: about as many as a sample may compare its place with, for all samples together."""
TURNS = 8
"""What a sample takes beside, in such triangles."""
LONGEST = 2**15
"""The most triangles that an invocation looks at: Mesa's llvmpipe leaves all loops of one after 65,535 turns."""
HIGH_TEXELS, LOW_TEXELS = 4, 9
"""Of the records of triangles in cell_samples_comp.glsl."""


@dataclass(frozen=True)
class Sorted:
    """The triangles of one mesh, or of several, cell by cell, as mesh.uv_cells.CellTriangles has them.

    starts (cells + 1,): where those of each cell begin. uv (N, 3, 2) float32. planes (N, 3, 3) float32: of the normals, at the
    center of the cell, and their slopes along x and y in texels; of the low mesh (N, 3, 9), with the tangents and the
    bitangents of its vertices. signs (N,): of the bitangents of the low mesh.
    """

    starts: np.ndarray
    uv: np.ndarray
    planes: np.ndarray
    signs: np.ndarray | None = None


@dataclass(frozen=True)
class Records:
    """The triangles of all cells on the GPU. cells: where those of each cell begin and end. lows: None if normals keep the
    space of the high mesh. counts (rows, columns) int64: how many triangles of both meshes each cell has."""

    counts: np.ndarray
    cells: gpu.types.GPUTexture
    highs: gpu.types.GPUTexture
    lows: gpu.types.GPUTexture | None


def upload(high: Sorted, low: Sorted | None, shape: tuple[int, int]) -> Records:
    """Upload triangles by cell. shape: rows and columns of cells. low: to turn normals into its tangent space, or None."""
    values, counts = np.zeros((*shape, 4), np.float32), np.zeros(shape, np.int64)
    for slot, triangles in enumerate([high] if low is None else [high, low]):
        counts += np.diff(triangles.starts).reshape(shape)
        values[..., 2 * slot] = triangles.starts[:-1].reshape(shape)
        values[..., 2 * slot + 1] = triangles.starts[1:].reshape(shape)
    buffer = gpu.types.Buffer("FLOAT", values.shape, values)
    cells = gpu.types.GPUTexture(shape[::-1], format="RGBA32F", data=buffer)
    return Records(counts, cells, _records(high, HIGH_TEXELS), low and _records(low, LOW_TEXELS))


def _records(triangles: Sorted, texels: int) -> gpu.types.GPUTexture:
    """The corners of each triangle, then the planes of its normal, then those of its tangent and its bitangent."""
    count = len(triangles.uv)
    padded = data_texture.empty(count * texels)
    records = padded[: count * texels].reshape(count, texels * 4)
    records[:, :6] = triangles.uv.reshape(count, 6)
    records[:, 6:15] = triangles.planes[..., :3].reshape(count, 9)
    if triangles.signs is not None:
        records[:, 15] = triangles.signs
        records[:, 16:25] = triangles.planes[..., 3:6].reshape(count, 9)
        records[:, 25:34] = triangles.planes[..., 6:].reshape(count, 9)
    return data_texture.upload_padded(padded)


def add(
    sums: gpu.types.GPUTexture,
    records: Records,
    places: np.ndarray,
    stops: np.ndarray,
    taken: Sequence[tuple[tuple[float, float], UvToClip]],
    *,
    side: int,
    basis_flags: int,
) -> Iterator[float]:
    """Add samples 2 to `stops` (N,) of the texels `places` (N, 2) int to their sums, as rounds.draw wrote them, and replace
    the sums by their means. Yields the share that is done.

    taken: the offsets of all samples, in texels, each with the transform with which it would be drawn. side: of a cell, in
    texels. basis_flags: as in tangent.draw.
    """
    if not len(places):
        return
    turns = records.counts[places[:, 1] // side, places[:, 0] // side] + 1  # of a sample, at most
    # Lanes that run together take as many samples, and those of crowded cells look at as many triangles.
    order = np.lexsort((stops, np.where(turns * len(taken) > LONGEST, turns, 0)))
    places, stops, turns = places[order], stops[order], turns[order]
    listed = np.column_stack([places, stops]).astype(np.float32)
    table, ends = data_texture.upload(listed), np.cumsum((stops - 2) * (turns + TURNS))
    steps = np.searchsorted(ends, np.arange(STEP, ends[-1], STEP))
    bounds = np.unique(np.r_[0, steps, len(places)])
    values = np.array([(*offset, *to_clip[2:]) for offset, to_clip in taken], np.float32)
    bound = {
        "sums": sums,
        "listed": table,
        "cells": records.cells,
        "offsets": data_texture.upload(values),
        "highs": records.highs,
        "lows": records.lows or records.highs,
        "uv_to_clip_scale": taken[0][1][:2],
        "cell_side": side,
        "is_turned": int(records.lows is not None),
        "basis_flags": basis_flags,
    }
    for first, stop in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        groups = -(-(stop - first) // BLOCK**2)
        across = min(groups, 1024)
        count, end = max(1, LONGEST // int(turns[first:stop].max())), int(stops[first:stop].max())
        for start in range(2, end, count):
            target.dispatch_groups(
                PROGRAM,
                (across, -(-groups // across)),
                listing=(first, stop, across, 0),
                first_sample=start,
                end_sample=min(start + count, end),
                **bound,
            )
        yield stop / len(places)
