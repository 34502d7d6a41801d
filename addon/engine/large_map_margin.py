# SPDX-License-Identifier: GPL-3.0-or-later
"""Completes the margin of large maps, where a band cannot see the texels it needs: those on other bands, beyond its halo."""

import gpu
import numpy as np

from ..core import texel_state
from ..passes import target
from ..passes.margin import margin_fill, margin_search, seam_fill

ROWS = 256
"""How many rows are filled at a time, so that memory does not grow with the map."""
COARSE = 4
"""How many times smaller the copy of the map is in which distant texels are searched. The texel found is at most
2 sqrt(2) COARSE texels farther away than the nearest."""


def across(texels: np.ndarray, state: np.ndarray, similarities: np.ndarray, kind: int, encode: np.ndarray) -> None:
    """Fill the texels that passes.margin.seam_fill deferred, as shaders/margin/seam_across_frag.glsl does for a whole map.

    texels (height, width, 4) float32, state (height, width) uint8: changed in place. similarities, kind, encode: as
    seam_fill.upload and seam_fill.draw take them.
    """
    for start in range(0, len(state), ROWS):
        y, x = np.nonzero(state[start : start + ROWS] == texel_state.DEFERRED)
        y += start
        border, right, up = texels[y, x, :3].astype(np.int64).T
        texels[y, x], state[y, x] = texels[y + up, x + right], texel_state.MARGIN
        numbers = similarities.astype(np.float64).view(np.complex128).reshape(-1, 4)[border]
        here, there, turn, is_mirrored = *numbers[:, :3].T, numbers[:, 3].real < 0.0

        steps = np.maximum(np.abs(right), np.abs(up))
        beside = x + right - np.floor(right / steps + 0.5) + 1j * (y + up - np.floor(up / steps + 0.5))
        first, position = (
            there + turn * np.where(is_mirrored, offset.conj(), offset)
            for offset in (texel + 0.5 + 0.5j - here for texel in (beside, x + 1j * y))
        )
        found = np.flatnonzero(_is_one_island(state, first, position))
        sums = _sums(texels, state, position[found], is_label=kind == seam_fill.LABEL)
        found, sums = found[sums[:, 3] > 0.0], sums[sums[:, 3] > 0.0]
        values = (sums[:, :3] / sums[:, 3:] - encode[:3, 3]) @ np.linalg.inv(encode[:3, :3]).T
        if kind == seam_fill.TANGENT:
            flat, rotor = values[:, 0] + 1j * values[:, 1], turn[found] / np.abs(turn[found])
            flat = np.where(is_mirrored[found], flat.conj() * rotor, flat * rotor.conj())
            values[:, 0], values[:, 1] = flat.real, flat.imag
        if kind in (seam_fill.NORMAL, seam_fill.TANGENT):
            length = np.linalg.norm(values, axis=1)
            has_direction = length > 0.0  # normals may cancel out: then the nearest texel stays
            found, values = found[has_direction], values[has_direction] / length[has_direction, None]
        texels[y[found], x[found], :3] = values @ encode[:3, :3].T + encode[:3, 3]


def beyond(texels: np.ndarray, state: np.ndarray, reach: int | None) -> None:
    """Fill the background within `reach` texels of written ones, or all of it, from the nearest or almost the nearest.

    texels (height, width, 4) float32, state (height, width) uint8: changed in place.
    """
    # One written texel of each block, if it has any.
    height, width = (-(-side // COARSE) for side in state.shape)
    values = np.zeros((height, width, 4), np.float32)
    for row, column in np.ndindex(COARSE, COARSE):
        part = state[row::COARSE, column::COARSE]
        block = values[: part.shape[0], : part.shape[1]]
        is_first = (part == texel_state.WRITTEN) & (block[..., 3] == 0.0)
        np.copyto(block, texels[row::COARSE, column::COARSE], where=is_first[..., None])
    uploaded = gpu.types.GPUTexture(
        (width, height), format="RGBA32F", data=gpu.types.Buffer("FLOAT", values.shape, values)
    )
    stored = target.get("coarse", width, height, "RGBA32F", "R8")
    nearest = margin_search.search(uploaded, None if reach is None else reach // COARSE)
    margin_fill.draw(stored, uploaded, nearest, halo=0, encode=np.eye(4), missed=(0.0, 0.0, 0.0))
    stored.read(values)
    for start in range(0, len(state), ROWS):
        y, x = np.nonzero(state[start : start + ROWS] == 0)
        y += start
        found = values[y // COARSE, x // COARSE]
        is_found = found[:, 3] > 0.0
        y, x = y[is_found], x[is_found]
        texels[y, x], state[y, x] = found[is_found], texel_state.MARGIN


def _is_one_island(state: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Whether the line between two positions (N,) on the map, x + y i in texels, crosses only covered texels: (N,) bool."""
    far = np.abs(stop - start)
    result = far <= seam_fill.FARTHEST
    for at in range(1, int(np.ceil(far[result].max(initial=0.0)))):
        checked = np.flatnonzero(result & (at < far))
        position = start[checked] + (stop[checked] - start[checked]) * (at / far[checked])
        result[checked] = np.isin(_state_at(state, position), (texel_state.WRITTEN, texel_state.MISSED))
    return result


def _sums(texels: np.ndarray, state: np.ndarray, position: np.ndarray, *, is_label: bool) -> np.ndarray:
    """Weighted sums of the written texels among the four around each position (N,): (N, 4) float64, w: sum of the weights."""
    corner = position - (0.0 if is_label else 0.5 + 0.5j)
    low = np.floor(corner.real) + 1j * np.floor(corner.imag)
    part = corner - low if not is_label else np.zeros_like(corner)
    sums = np.zeros((len(position), 4))
    for row, column in np.ndindex(2, 2):
        weight = np.abs(1 - column - part.real) * np.abs(1 - row - part.imag)
        weight[_state_at(state, low + column + 1j * row) != texel_state.WRITTEN] = 0.0
        x, y = _indices(state, low + column + 1j * row)
        sums[:, :3] += weight[:, None] * texels[y, x, :3]
        sums[:, 3] += weight
    return sums


def _state_at(state: np.ndarray, position: np.ndarray) -> np.ndarray:
    """The state of the texels that contain the positions, 0 outside the map."""
    x, y = _indices(state, position)
    is_inside = (x == np.floor(position.real)) & (y == np.floor(position.imag))
    return np.where(is_inside, state[y, x], 0)


def _indices(state: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of the texels nearest to the positions."""
    height, width = state.shape
    return (
        np.clip(np.floor(position.real), 0, width - 1).astype(np.int64),
        np.clip(np.floor(position.imag), 0, height - 1).astype(np.int64),
    )
