# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what an engine would show of a file against what was baked: decodes normals as the shaders of engines do, in double
precision."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.declarations import bases
from ..core.declarations.bases import Basis
from ..core.declarations.targets import TargetEngine
from ..core.errors import BakeError
from ..mesh.triangle_mesh import tangent_axes
from ..mesh.triangles import angles_between, unit
from . import map_pictures
from .baked_low import FileMesh


def decoded(
    basis: Basis, values: np.ndarray, weights: np.ndarray, normals: np.ndarray, tangents: np.ndarray
) -> np.ndarray:
    """The normals (N, 3) float64, of length one, that a program with this basis makes of tangent-space ones.

    values (N, 3): of the map. weights (N, 3): of the corners of each point's triangle. normals (N, 3, 3), tangents (N, 3, 4):
    of those corners, w the sign of the bitangent.
    """
    axes = tangent_axes(basis, weights, normals, tangents)
    return unit(sum(values[:, [number]] * axis for number, axis in enumerate(axes)))


POINTS = 200_000
"""Texels that are compared, at most."""
POSITION_LIMIT, UV_LIMIT = 1e-4, 1e-4
"""What a file may round: shares of the mesh's size, and of the map's."""


@dataclass(frozen=True)
class Baked:
    """What was baked, in the order of the file's triangles.

    Attributes:
        positions, normals (T, 3, 3), tangents (T, 3, 4), uv (T, 3, 2): Of the corners.
        textures (T,): The map of each triangle.
        texels_of: The texels (height, width, 4) of a map as the bake stored them, in the channels of map_pictures.CHANNELS, or
            None without one.
    """

    positions: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray
    uv: np.ndarray
    textures: np.ndarray
    basis: Basis
    texels_of: Callable[[int], np.ndarray | None]


@dataclass(frozen=True)
class Measured:
    """How far what an engine makes of the file is from what was baked.

    Attributes:
        degrees: Between the normals, by the name of the engine's basis: median, percentile_95, percentile_99, maximum.
        targets: The same by the names of programs.
        points: How many texels were compared.
        has_tangents: Whether the file has its own.
    """

    degrees: dict[str, dict[str, float]]
    targets: dict[str, dict[str, float]]
    points: int
    has_tangents: bool


def check_surface(baked: Baked, mesh: FileMesh, name: str) -> None:
    """Raise BakeError unless the file has the triangles, corners and UVs that were baked."""
    if mesh.positions.shape != baked.positions.shape:
        raise BakeError(
            f"The file has {len(mesh.positions):,} triangles of {name!r} where {len(baked.positions):,} were baked: it was "
            "not written."
        )
    size = float(np.ptp(baked.positions.reshape(-1, 3), axis=0).max()) or 1.0
    if np.abs(mesh.positions - baked.positions).max() > POSITION_LIMIT * size:
        raise BakeError(f"The file has other triangles of {name!r} than were baked: it was not written.")
    if not np.array_equal(mesh.materials, baked.textures):
        raise BakeError(f"The file has other materials of {name!r} than were baked: it was not written.")
    if np.abs(mesh.uv - baked.uv).max() > UV_LIMIT:
        raise BakeError(f"The file has other UVs of {name!r} than were baked: it was not written.")


def measure(
    baked: Baked,
    mesh: FileMesh,
    texels_in: Callable[[int], np.ndarray | None],
    targets: Sequence[TargetEngine] = (),
    channels: Sequence[str] = (),
) -> Measured | None:
    """Compare the normals of texels. texels_in: as Baked.texels_of, of a texture of the file. None without normal maps.

    targets: the programs to measure as well. channels: the axes in red, green and blue, where the format does not say them.

    Engines make tangents of their own for files without: then those of the bake are taken.
    """
    tangents = baked.tangents if mesh.tangents is None else mesh.tangents
    ways = {basis.name: (basis, None) for basis in bases.BASES}
    ways |= {target.name: (target.basis, target) for target in targets}
    angles: dict[str, list[np.ndarray]] = {name: [] for name in ways}
    for texture in np.unique(baked.textures).tolist():
        texels = baked.texels_of(texture)
        if texels is None:
            continue
        stored = texels_in(texture)
        if stored is None:
            raise BakeError("The file has no normal map where one was baked: it was not written.")
        chosen = np.flatnonzero(baked.textures == texture)
        triangles, weights, uv = points(baked.uv[chosen], texels.shape[1], texels.shape[0])
        triangles = chosen[triangles]
        truth = decoded(
            baked.basis, _looked_up(texels, uv), weights, baked.normals[triangles], baked.tangents[triangles]
        )
        values = _looked_up(stored, np.einsum("nc,nck->nk", weights, mesh.uv[triangles]))
        for name, (basis, target) in ways.items():
            read = values if target is None else _read_by(target, values, channels)
            shown = decoded(basis, read, weights, mesh.normals[triangles], tangents[triangles])
            angles[name].append(np.degrees(angles_between(truth, shown)))
    if not any(angles.values()):
        return None
    metrics = {name: _metrics(np.concatenate(parts)) for name, parts in angles.items()}
    return Measured(
        {basis.name: metrics[basis.name] for basis in bases.BASES},
        {target.name: metrics[target.name] for target in targets},
        sum(map(len, angles[bases.BASES[0].name])),
        mesh.has_tangents and mesh.tangents is not None,
    )


def _read_by(target: TargetEngine, values: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """The values (N, 3) that a program reads of a map's. channels: as in `measure`."""
    read = values.copy()
    for number, (wanted, stored) in enumerate(zip(("+X", target.green, "+Z"), channels, strict=False)):
        read[:, number] = values[:, "XYZ".index(stored[1])] * (1.0 if stored[0] == wanted[0] else -1.0)
    if target.rebuilds_z:
        read[:, 2] = np.sqrt(np.maximum(1.0 - (read[:, :2] ** 2).sum(axis=1), 0.0))
    return read


def points(uv: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centers of texels inside triangles: the triangle (N,), the weights of its corners (N, 3), and the UVs (N, 2) float64.

    uv: (T, 3, 2). Always the same ones, evenly spread over UV space.
    """
    uv = uv.astype(np.float64)
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    areas = np.abs(twice)
    if not areas.sum() > 0.0:
        return np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 2))
    random = np.random.default_rng(1)
    count = min(POINTS, max(1000, int(areas.sum() / 2 * width * height)))
    triangles = np.searchsorted(np.cumsum(areas) / areas.sum(), random.random(count)).clip(0, len(uv) - 1)
    along = random.random((2, count))
    along = np.where(along.sum(axis=0) > 1.0, 1.0 - along, along)
    places = uv[triangles, 0] + along[0][:, None] * a[triangles] + along[1][:, None] * b[triangles]
    size = np.array([width, height])
    centers = (np.floor(places * size) + 0.5) / size
    offset = centers - uv[triangles, 0]
    at, bt, area = a[triangles], b[triangles], twice[triangles]
    second = (offset[:, 0] * bt[:, 1] - offset[:, 1] * bt[:, 0]) / area
    third = (at[:, 0] * offset[:, 1] - at[:, 1] * offset[:, 0]) / area
    weights = np.stack([1.0 - second - third, second, third], axis=1)
    inside = weights.min(axis=1) >= 0.0
    return triangles[inside], weights[inside], centers[inside]


def _looked_up(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The vectors (N, 3) at `uv`, repeated outside 0 to 1."""
    height, width = texels.shape[:2]
    column, row = (np.floor(uv * [width, height]).astype(np.int64) % [width, height]).T
    return map_pictures.directions(texels[row, column])


def _metrics(angles: np.ndarray) -> dict[str, float]:
    if not len(angles):
        return dict.fromkeys(("median", "percentile_95", "percentile_99", "maximum"), 0.0)
    median, high, higher = np.percentile(angles, (50, 95, 99))
    return {
        "median": float(median),
        "percentile_95": float(high),
        "percentile_99": float(higher),
        "maximum": float(angles.max()),
    }
