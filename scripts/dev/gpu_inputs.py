# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes and images of the test of the GPU, as formulas. gpu_answers.py stores them in addon/jobs/gpu_answers.npz."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from addon.jobs.gpu_pairs import SIZE
from addon.mesh.triangle_mesh import ATTRIBUTE, Mesh

INSET = 2.25
"""Texels from the border of a map to that of an island. A quarter of a texel is far from all centers, so that
rasterizers agree on the texels that are covered."""

Place = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Points (N, 3) of s and t (N,), both from 0 to 1."""


@dataclass(frozen=True)
class Sheet:
    """A surface over (s, t) from 0 to 1 in columns x rows of quads. With `is_mirrored`, u runs against s.

    box: the least and the largest UVs, as (u, v, u, v).
    """

    place: Place
    box: tuple[float, float, float, float]
    columns: int
    rows: int
    is_mirrored: bool = False

    @property
    def st(self) -> tuple[np.ndarray, np.ndarray]:
        """s and t of the points (N,), rows of constant t."""
        s, t = np.meshgrid(np.linspace(0.0, 1.0, self.columns + 1), np.linspace(0.0, 1.0, self.rows + 1))
        return s.ravel(), t.ravel()

    @property
    def triangles(self) -> np.ndarray:
        """Indices of the points (T, 3)."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        first = (row * (self.columns + 1) + column).ravel()
        above = first + self.columns + 1
        both = [[first, first + 1, above + 1], [first, above + 1, above]]
        return np.array(both).transpose(2, 0, 1).reshape(-1, 3)

    @property
    def uv(self) -> np.ndarray:
        """(N, 2) float64."""
        s, t = self.st
        low, high = np.array(self.box).reshape(2, 2)
        return low + (high - low) * np.stack([1.0 - s if self.is_mirrored else s, t], axis=-1)

    @property
    def frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit normals (N, 3), and tangents (N, 4) as MikkTSpace has them of smooth surfaces: along u, w for the bitangent."""
        (s, t), step = self.st, 1e-5
        along = self.place(s + step, t) - self.place(s - step, t)
        normals = _unit(np.cross(along, self.place(s, t + step) - self.place(s, t - step)))
        sign = -1.0 if self.is_mirrored else 1.0
        tangents = _unit(sign * (along - normals * (along * normals).sum(axis=1, keepdims=True)))
        return normals, np.column_stack([tangents, np.full(len(s), sign)])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def mesh_of(name: str, *sheets: Sheet) -> Mesh:
    """The mesh of some sheets, with smooth normals and with tangents."""
    firsts = np.cumsum([0, *(len(sheet.uv) for sheet in sheets)])
    normals, tangents = map(np.concatenate, zip(*(sheet.frames for sheet in sheets), strict=True))
    triangles = np.concatenate([first + sheet.triangles for first, sheet in zip(firsts, sheets, strict=False)])
    vertices = triangles.ravel().astype(np.int32)
    made = Mesh.of_arrays(
        name,
        np.concatenate([sheet.place(*sheet.st) for sheet in sheets]),
        triangles,
        np.concatenate([sheet.uv for sheet in sheets]),
    )
    return replace(made, normals=normals[vertices].astype(np.float32), tangents=tangents[vertices].astype(np.float32))


def box(first: float, last: float, low: float = INSET, high: float = SIZE - INSET) -> tuple[float, ...]:
    """UVs of an island from columns `first` to `last`, in texels."""
    return tuple(value / SIZE for value in (first, low, last, high))


WHOLE = box(INSET, SIZE - INSET)
LEFT, RIGHT = box(INSET, 21.75), box(26.25, SIZE - INSET)


def _dome(turn: float, bumps: float) -> Place:
    """A part of a sphere around the point at a longitude of `turn` degrees, with bumps."""

    def place(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        a, b = np.radians(turn + 110.0 * (s - 0.5)), np.radians(100.0 * (t - 0.5))
        radius = 1.0 + bumps * (1.0 + 0.35 * np.sin(7.0 * s + turn) * np.cos(6.0 * t))
        return radius[:, None] * np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)], axis=-1)

    return place


def domes() -> list[Mesh]:
    """Coarse parts of a sphere, one with mirrored UVs, below fine ones. All tangent bases differ on them."""
    high = Sheet(_dome(0.0, 0.06), LEFT, 28, 28), Sheet(_dome(180.0, 0.06), RIGHT, 28, 28, is_mirrored=True)
    return [_low_domes(), mesh_of("high", *high)]


def wide_domes() -> list[Mesh]:
    """The same low mesh below parts of a sphere that are larger, so that no ray misses them. They share no UVs."""

    def wider(place: Place) -> Place:
        return lambda s, t: place(1.2 * s - 0.1, 1.2 * t - 0.1)

    high = (Sheet(wider(_dome(turn, 0.06)), WHOLE, 28, 28) for turn in (0.0, 180.0))
    return [_low_domes(), mesh_of("high", *high)]


def _low_domes() -> Mesh:
    left, right = _dome(0.0, 0.0), _dome(180.0, 0.0)
    return mesh_of("low", Sheet(left, LEFT, 3, 3), Sheet(right, RIGHT, 3, 3, is_mirrored=True))


def flat(height: float = 0.0, least: float = -1.0, most: float = 1.0) -> Place:
    """A level part of the square from -1 to 1, in x from `least` to `most`."""
    return lambda s, t: np.stack([least + (most - least) * s, 2.0 * t - 1.0, np.full_like(s, height)], axis=-1)


def wave(height: float) -> Place:
    """Waves above or below a height."""

    def place(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        z = height + 0.03 * np.sin(9.0 * s + 20.0 * height) * np.sin(8.0 * t + 1.0)
        return np.stack([2.0 * s - 1.0, 2.0 * t - 1.0, z], axis=-1)

    return place


def layers() -> list[Mesh]:
    """A floor and a roof close above it, both low and high: rays meet the roof first, and the floor has its own detail."""
    low = mesh_of("low", Sheet(flat(0.0), LEFT, 2, 2), Sheet(flat(0.25), RIGHT, 2, 2))
    high = mesh_of("high", Sheet(wave(0.0), LEFT, 24, 24), Sheet(wave(0.25), RIGHT, 24, 24))
    return [low, high]


def column(texels: int) -> float:
    """The x of a flat low mesh on all of the map, a quarter past the center of a texel of the map less a half."""
    return texels / (SIZE / 2.0 - INSET) - 1.0


STEPS = (-1.0, column(9), column(18), column(26), column(33), 1.0)
HEIGHTS = (0.0, 0.35, 0.0, -0.4, 0.1)


def blocks_of(breaks: tuple[float, ...], heights: tuple[float, ...], bottom: float) -> Mesh:
    """Blocks side by side, closed all around, with flat faces."""
    quads = []
    for left, right, top in zip(breaks, breaks[1:], heights, strict=False):
        (x0, x1), (z0, z1) = (left, right), (bottom, top)
        quads += [
            [(x0, -1, z1), (x1, -1, z1), (x1, 1, z1), (x0, 1, z1)],
            [(x0, 1, z0), (x1, 1, z0), (x1, -1, z0), (x0, -1, z0)],
            [(x0, -1, z0), (x1, -1, z0), (x1, -1, z1), (x0, -1, z1)],
            [(x1, 1, z0), (x0, 1, z0), (x0, 1, z1), (x1, 1, z1)],
        ]
    ends = [(breaks[0], bottom, heights[0]), (breaks[-1], heights[-1], bottom)]
    ends += [(x, left, right) for x, left, right in zip(breaks[1:], heights, heights[1:], strict=False)]
    for x, before, after in ends:  # walls look to the lower side
        quads.append([(x, 1, before), (x, -1, before), (x, -1, after), (x, 1, after)])
    corners = np.array(quads, np.float64)
    first = 4 * np.arange(len(quads))[:, None]
    triangles = np.concatenate([first + (0, 1, 2), first + (0, 2, 3)], axis=1).reshape(-1, 3)
    return Mesh.of_arrays("high", corners.reshape(-1, 3), triangles)


def blocks() -> list[Mesh]:
    """A level low mesh through blocks of several heights."""
    return [mesh_of("low", Sheet(flat(), WHOLE, 1, 1)), blocks_of(STEPS, HEIGHTS, -0.8)]


def tents() -> list[Mesh]:
    """A level low mesh below flat faces whose edges run across texels."""

    def place(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        x, y = 2.0 * s - 1.0, 2.0 * t - 1.0
        z = 0.08 * np.sin(37.0 * x + 5.0 * y) + 0.05 * np.cos(29.0 * y - 11.0 * x)
        return np.stack([x, y, z], axis=-1)

    sheet = Sheet(place, WHOLE, 7, 7)
    high = Mesh.of_arrays("high", place(*sheet.st), sheet.triangles, sheet.uv)
    return [mesh_of("low", Sheet(flat(), WHOLE, 1, 1)), high]


SPLIT = column(22)


def _tilted(height: float, along: float, across: float, least: float, most: float) -> Place:
    def place(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        points = flat(0.0, least, most)(s, t)
        points[:, 2] = height + along * points[:, 0] + across * points[:, 1]
        return points

    return place


def tilted() -> list[Mesh]:
    """A level low mesh below two tilted sheets, which are objects of their own, each with two materials."""
    sides = ((0.1, 0.2, -0.1, -1.0, SPLIT), (-0.05, -0.15, 0.12, SPLIT, 1.0))
    highs = []
    for number, side in enumerate(sides, start=1):
        made = mesh_of(f"high {number}", Sheet(_tilted(*side), WHOLE, 1, 2))
        materials = 2 * number - 1 + (np.arange(len(made.triangles)) >= 2)
        highs.append(replace(made, labels=np.stack([np.full_like(materials, number), materials], 1).astype(np.float32)))
    return [mesh_of("low", Sheet(flat(), WHOLE, 1, 1)), *highs]


# Materials

PIXELS = 13
"""Of an image along each side: they are larger than texels."""


def image_of(key: str) -> np.ndarray:
    """An image of the materials, (PIXELS, PIXELS, 4) float32, row 0 at v = 0."""
    row, column_ = np.meshgrid(np.arange(PIXELS), np.arange(PIXELS), indexing="ij")
    values = np.ones((PIXELS, PIXELS, 4))
    if key == "color":
        values[..., 0] = (row * 5 + column_ * 3) % 11 / 10.0
        values[..., 1] = (row * 2 + column_ * 7) % 13 / 12.0
        values[..., 2] = (row * column_) % 7 / 6.0
    elif key == "normals":
        normals = np.stack([0.3 * np.sin(column_ * 1.3), 0.3 * np.cos(row * 1.7), np.ones_like(row)], axis=-1)
        values[..., :3] = 0.5 + 0.5 * _unit(normals)
    else:
        values[..., :3] = ((column_ * 4 + row * 3) % 9 / 8.0)[..., None]
    return values.astype(np.float32)


def painted(points: np.ndarray) -> np.ndarray:
    """The attribute (N, 4) at points (N, 3): it changes linearly."""
    x, y = points[:, 0], points[:, 1]
    return np.stack([0.5 + 0.4 * x, 0.5 - 0.3 * y, 0.5 + 0.2 * x + 0.2 * y, np.ones_like(x)], axis=-1)


def _painted(mesh: Mesh) -> Mesh:
    """The mesh with the attribute."""
    values = painted(mesh.positions)[mesh.vertices].astype(np.float32)
    return replace(mesh, layers={(ATTRIBUTE, "paint"): values})


LIMITS_OF_MATERIALS = (column(13), column(30))
"""Where one material ends and the next begins."""


def colored() -> list[Mesh]:
    """A level sheet with three materials, of an image, an attribute and constants."""
    first, second = (0.5 + 0.5 * x for x in LIMITS_OF_MATERIALS)
    edges, sheets = (0.0, first, second, 1.0), []
    u0, v0, u1, v1 = WHOLE
    for left, right in zip(edges, edges[1:], strict=False):
        part = (u0 + (u1 - u0) * left, v0, u0 + (u1 - u0) * right, v1)
        sheets.append(Sheet(flat(0.02, 2.0 * left - 1.0, 2.0 * right - 1.0), part, 1, 1))
    high = _painted(mesh_of("high", *sheets))
    labels = np.stack([np.ones(6), np.repeat((1, 2, 3), 2)], axis=1).astype(np.float32)
    low = mesh_of("low", Sheet(flat(), WHOLE, 1, 1))
    return [low, replace(high, labels=labels)]


def bumpy() -> list[Mesh]:
    """A level sheet with a normal map and a bump map of its own."""
    high = _painted(mesh_of("high", Sheet(flat(0.02), WHOLE, 2, 2)))
    labels = np.ones((len(high.triangles), 2), np.float32)
    return [mesh_of("low", Sheet(flat(), WHOLE, 1, 1)), replace(high, labels=labels)]


CUT = 0.3
"""The x of a UV seam."""
CUT_LEFT, CUT_RIGHT = box(5.25, 21.75, 5.25, 42.75), box(31.25, 31.25 + 16.5 * (1.0 - CUT) / (1.0 + CUT), 5.25, 42.75)


def cut() -> list[Mesh]:
    """A level low mesh whose UVs are two islands of the same scale, below a sheet with an attribute."""
    halves = Sheet(flat(0.0, -1.0, CUT), CUT_LEFT, 1, 1), Sheet(flat(0.0, CUT, 1.0), CUT_RIGHT, 1, 1)
    low = mesh_of("low", *halves)
    # Both halves share the vertices of the seam.
    numbers = np.array([0, 1, 2, 3, 1, 4, 3, 5], np.int32)
    joined = np.zeros((6, 3), np.float32)
    joined[numbers] = low.positions
    low = replace(low, positions=joined, vertices=numbers[low.vertices])
    high = _painted(mesh_of("high", Sheet(flat(0.05), WHOLE, 3, 3)))
    return [low, replace(high, labels=np.ones((len(high.triangles), 2), np.float32))]


def tiled() -> list[Mesh]:
    """Waves on two UDIM tiles, 1002 and 1011."""
    (u0, v0, u1, v1), sheets = WHOLE, []
    for height, (right, up) in ((0.0, (1, 0)), (0.25, (0, 1))):
        place = (u0 + right, v0 + up, u1 + right, v1 + up)
        sheets.append((Sheet(flat(height), place, 1, 1), Sheet(wave(height), place, 20, 20)))
    lows, highs = zip(*sheets, strict=True)
    return [mesh_of("low", *lows), mesh_of("high", *highs)]


MESHES = {
    "domes": domes,
    "wide_domes": wide_domes,
    "layers": layers,
    "blocks": blocks,
    "tents": tents,
    "tilted": tilted,
    "colored": colored,
    "bumpy": bumpy,
    "cut": cut,
    "tiled": tiled,
}
"""The low mesh and the high ones, by their name in `Pair.meshes`."""


def arrays() -> dict[str, np.ndarray]:
    """All meshes and images by key, as `gpu_pairs.Arrays`."""
    made = {f"images/{key}": image_of(key) for key in ("color", "normals", "bumps")}
    for name, meshes in MESHES.items():
        for number, mesh in enumerate(meshes()):
            made |= {f"meshes/{name}/{number}/{field}": values for field, values in _fields(mesh, number).items()}
    return made


def _fields(mesh: Mesh, number: int) -> dict[str, np.ndarray]:
    """What `gpu_pairs.meshes_of` reads of a mesh. number: of the high object, 0 for the low one."""
    corners = np.arange(len(mesh.vertices)).reshape(-1, 3)
    assert np.array_equal(mesh.triangles, corners), "corners are in the order of the triangles"
    found = {"positions": mesh.positions, "vertices": mesh.vertices.astype(np.uint16), "normals": mesh.normals}
    found |= {} if mesh.uv is None else {"uv": mesh.uv}
    if mesh.tangents is not None and (number == 0 or mesh.layers):  # else nobody reads them
        found["tangents"] = mesh.tangents
    if mesh.layers:
        found["paint"] = mesh.layers[ATTRIBUTE, "paint"]
    if number:
        labels = np.tile(np.array([number, 0], np.float32), (len(mesh.triangles), 1))
        found["labels"] = labels if mesh.labels is None else mesh.labels
    return found
