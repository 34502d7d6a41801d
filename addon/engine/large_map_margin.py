# SPDX-License-Identifier: GPL-3.0-or-later
"""What no band of a large map can see: texels across seams on other bands, and those farther away than its halo."""

import gpu
import numpy as np

from ..core import texel_state
from ..passes import target
from ..passes.margin import nearest_texel, resolve, seam_fill

ROWS = 256
"""How many rows are filled at a time, so that memory does not grow with the map."""
COARSE = 4
"""How many times smaller the copy of the map is in which the nearest texel is looked for when it is far away: the one that
is found is at most 2 sqrt(2) times as many texels farther away than the nearest."""


def across(texels: np.ndarray, state: np.ndarray, similarities: np.ndarray, kind: int, encode: np.ndarray) -> None:
    """Fill the texels that passes.seams left deferred, as shaders/margin/across_frag.glsl does where it sees the whole map.

    texels (height, width, 4) float32, state (height, width) uint8: changed in place. similarities, kind, encode: as
    seam_fill.upload and seam_fill.draw had them.
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
        first, place = (
            there + turn * np.where(is_mirrored, offset.conj(), offset)
            for offset in (texel + 0.5 + 0.5j - here for texel in (beside, x + 1j * y))
        )
        found = np.flatnonzero(_is_one_island(state, first, place))
        sums = _sums(texels, state, place[found], is_label=kind == seam_fill.LABEL)
        found, sums = found[sums[:, 3] > 0.0], sums[sums[:, 3] > 0.0]
        values = (sums[:, :3] / sums[:, 3:] - encode[:3, 3]) @ np.linalg.inv(encode[:3, :3]).T
        if kind == seam_fill.TANGENT:
            flat, rotor = values[:, 0] + 1j * values[:, 1], turn[found] / np.abs(turn[found])
            flat = np.where(is_mirrored[found], flat.conj() * rotor, flat * rotor.conj())
            values[:, 0], values[:, 1] = flat.real, flat.imag
        if kind in (seam_fill.NORMAL, seam_fill.TANGENT):
            length = np.linalg.norm(values, axis=1)
            known = length > 0.0  # where normals cancel out there is no direction: the nearest texel stays
            found, values = found[known], values[known] / length[known, None]
        texels[y[found], x[found], :3] = values @ encode[:3, :3].T + encode[:3, 3]


def beyond(texels: np.ndarray, state: np.ndarray, reach: int | None) -> None:
    """Fill the background within `reach` texels of written ones, or all of it, from the nearest or almost the nearest.

    texels (height, width, 4) float32, state (height, width) uint8: changed in place.
    """
    # Of each block one written texel, if there is any.
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
    nearest = nearest_texel.search(uploaded, None if reach is None else reach // COARSE)
    resolve.draw(stored, uploaded, nearest, halo=0, encode=np.eye(4), missed=(0.0, 0.0, 0.0))
    stored.read(values)
    for start in range(0, len(state), ROWS):
        y, x = np.nonzero(state[start : start + ROWS] == 0)
        y += start
        found = values[y // COARSE, x // COARSE]
        is_found = found[:, 3] > 0.0
        y, x = y[is_found], x[is_found]
        texels[y, x], state[y, x] = found[is_found], texel_state.MARGIN


def _is_one_island(state: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Whether the way between two places (N,) of the map, x + y i in texels, leads over covered texels alone: (N,) bool."""
    far = np.abs(stop - start)
    result = far <= seam_fill.FARTHEST
    for at in range(1, int(np.ceil(far[result].max(initial=0.0)))):
        some = np.flatnonzero(result & (at < far))
        place = start[some] + (stop[some] - start[some]) * (at / far[some])
        result[some] = np.isin(_state_at(state, place), (texel_state.WRITTEN, texel_state.MISSED))
    return result


def _sums(texels: np.ndarray, state: np.ndarray, place: np.ndarray, *, is_label: bool) -> np.ndarray:
    """The written ones of the four texels around each place (N,), by their weights: (N, 4) float64, the last their sum."""
    corner = place - (0.0 if is_label else 0.5 + 0.5j)
    low = np.floor(corner.real) + 1j * np.floor(corner.imag)
    part = corner - low if not is_label else np.zeros_like(corner)
    sums = np.zeros((len(place), 4))
    for row, column in np.ndindex(2, 2):
        weight = np.abs(1 - column - part.real) * np.abs(1 - row - part.imag)
        weight[_state_at(state, low + column + 1j * row) != texel_state.WRITTEN] = 0.0
        x, y = _indices(state, low + column + 1j * row)
        sums[:, :3] += weight[:, None] * texels[y, x, :3]
        sums[:, 3] += weight
    return sums


def _state_at(state: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The state of the texels in which places lie, 0 outside the map."""
    x, y = _indices(state, place)
    is_inside = (x == np.floor(place.real)) & (y == np.floor(place.imag))
    return np.where(is_inside, state[y, x], 0)


def _indices(state: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of the texels that are nearest to places."""
    height, width = state.shape
    return (
        np.clip(np.floor(place.real), 0, width - 1).astype(np.int64),
        np.clip(np.floor(place.imag), 0, height - 1).astype(np.int64),
    )
