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
    texels=tuple(("RGBA32F", "FLOAT_2D", name) for name in ("listed", "cells", "offsets", "triangles")),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(
        ("IVEC4", "listing"),
        *(("INT", name) for name in ("first_sample", "end_sample", "cell_side")),
        ("VEC2", "uv_to_clip_scale"),
    ),
)
STEP = 2**24
"""The triangles after which a step ends: about as many as a sample may compare its place with, for all samples together."""
TURNS = 8
"""What a sample takes beside, in such triangles."""
LONGEST = 2**15
"""The most triangles that an invocation looks at: Mesa's llvmpipe leaves all loops of one after 65,535 turns."""
RECORD = 4
"""The texels of a triangle in cell_samples_comp.glsl."""


@dataclass(frozen=True)
class Sorted:
    """The triangles of one mesh, or of several, cell by cell, as mesh.uv_cells.CellTriangles has them.

    starts (cells + 1,): where those of each cell begin. uv (N, 3, 2) float32. planes (N, 3, 3) float32: of the normals, at the
    center of the cell, and their slopes along x and y in texels.
    """

    starts: np.ndarray
    uv: np.ndarray
    planes: np.ndarray


@dataclass(frozen=True)
class Records:
    """The triangles of all cells on the GPU. counts (rows, columns) int64: how many each cell has. cells: where those of each
    cell begin and end. triangles: the corners of each, then the planes of its normal."""

    counts: np.ndarray
    cells: gpu.types.GPUTexture
    triangles: gpu.types.GPUTexture


def upload(found: Sorted, shape: tuple[int, int]) -> Records:
    """Upload triangles by cell. shape: rows and columns of cells."""
    values = np.zeros((*shape, 4), np.float32)
    values[..., 0] = found.starts[:-1].reshape(shape)
    values[..., 1] = found.starts[1:].reshape(shape)
    buffer = gpu.types.Buffer("FLOAT", values.shape, values)
    cells = gpu.types.GPUTexture(shape[::-1], format="RGBA32F", data=buffer)
    count = len(found.uv)
    padded = data_texture.empty(count * RECORD)
    records = padded[: count * RECORD].reshape(count, RECORD * 4)
    records[:, :6] = found.uv.reshape(count, 6)
    records[:, 6:15] = found.planes.reshape(count, 9)
    return Records(np.diff(found.starts).reshape(shape), cells, data_texture.upload_padded(padded))


def add(
    sums: gpu.types.GPUTexture,
    records: Records,
    places: np.ndarray,
    stops: np.ndarray,
    taken: Sequence[tuple[tuple[float, float], UvToClip]],
    *,
    side: int,
) -> Iterator[float]:
    """Add samples 2 to `stops` (N,) of the texels `places` (N, 2) int to their sums, as rounds.draw wrote them, and replace
    the sums by their means. Yields the share that is done.

    taken: the offsets of all samples, in texels, each with the transform with which it would be drawn. side: of a cell, in
    texels.
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
        "triangles": records.triangles,
        "uv_to_clip_scale": taken[0][1][:2],
        "cell_side": side,
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
