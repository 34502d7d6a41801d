# SPDX-License-Identifier: GPL-3.0-or-later
"""Small pairs of meshes, made of numbers alone, that together are baked by all passes, and how much their maps may differ.

`gpu_answers.npz` has what their maps should be; scripts/dev/gpu_answers.py says how each is known.
"""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..audit.deviations import Deviations
from ..core.declarations import bases
from ..core.declarations.choices import Method, Space
from ..core.gpu_report import Outcome, Verdict
from ..core.map_types import BY_NAME, WRITTEN, Channel, Kind, Map, Packing
from ..core.material_feeds import (
    AttributeFeed,
    BumpFeed,
    Constant,
    Extension,
    HighMaterial,
    ImageFeed,
    ImagePixels,
    NormalMapFeed,
)
from ..core.progress import Pace, Task
from ..core.settings import Run, Settings
from ..core.udim import FIRST
from ..engine import baking, normal_space, stacked_uvs
from ..engine.bands import Band
from ..engine.method_choice import choose_method
from ..engine.sampling import maps_of_bake
from ..engine.sources import normal_source
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import ATTRIBUTE, TANGENTS, UV_LAYER, Mesh
from ..output import value_encoding
from ..passes import audit, data_texture, lit, mesh_upload

ANSWERS = Path(__file__).with_name("gpu_answers.npz")
SIZE = 48
"""Texels along each side of a map."""
INSET = 2.25
"""Texels from the border of a map to that of an island. A quarter of a texel is far from all centers, so that
rasterizers agree on the texels that are covered."""

Place: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Points (N, 3) of s and t (N,), both from 0 to 1."""
Maps: TypeAlias = dict[str, Map]
"""Texels and states by name; those of UDIM tiles have the tile's number after the name."""


@dataclass(frozen=True)
class Limit:
    """How far a map may be from its answer.

    off: degrees of a normal, or a difference of a number. share: of the texels that may differ more, as single rays that graze
    an edge do. most: what no texel may differ by.
    """

    off: float
    share: float = 0.0
    most: float = np.inf


SNAPPED = Limit(0.05)
"""Degrees. Rasterizers put corners on 1/256 texel, where these normals turn by at most 8 degrees from texel to texel."""
EXACT = Limit(2e-5)
"""Numbers that few roundings make, from 0 to 1."""


@dataclass(frozen=True)
class Pair:
    """One bake. name: for the report. meshes: makes them. settings: by their names. limits: by map. make: bakes."""

    name: str
    meshes: Callable[[], Meshes]
    settings: Mapping[str, Any]
    limits: Mapping[str, Limit]
    make: Callable[[Meshes, Run], Task[Maps]] = field(default_factory=lambda: _baked)

    def limit(self, name: str) -> Limit:
        """That of a map; the maps of all UDIM tiles have the same."""
        return self.limits[name.partition(" ")[0]]

    def bake(self, pace: Pace | None = None) -> Task[Maps]:
        """Bake the pair. pace: of the slices."""
        maps = tuple(name for name in self.limits if name in BY_NAME and name != "NORMAL")
        usual = {"width": SIZE, "height": SIZE, "margin": 0, "space": Space.WORLD, "maps": maps}
        run = Run(Settings(**{**usual, **self.settings}), pace or Pace())
        return (yield from self.make(self.meshes(), run))


def _baked(meshes: Meshes, run: Run) -> Task[Maps]:
    tiles = yield from baking.bake(meshes, run)
    if list(tiles) == [FIRST]:
        return tiles[FIRST]
    return {f"{name} {tile}": found for tile, maps in tiles.items() for name, found in maps.items()}


# Meshes


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


def pair_of(low: Mesh, *highs: Mesh, materials: tuple[HighMaterial, ...] = (), **more: Any) -> Meshes:
    """labels of the high meshes that have some stay."""
    meshes = Meshes.of(low, list(highs))
    kept = [new if old.labels is None else old for new, old in zip(meshes.highs, highs, strict=True)]
    return replace(meshes, highs=kept, basis=low, materials=list(materials), **more)


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


@functools.cache
def domes() -> Meshes:
    """Coarse parts of a sphere, one with mirrored UVs, below fine ones. All tangent bases differ on them."""
    high = Sheet(_dome(0.0, 0.06), LEFT, 28, 28), Sheet(_dome(180.0, 0.06), RIGHT, 28, 28, is_mirrored=True)
    return pair_of(_low_domes(), mesh_of("high", *high))


@functools.cache
def wide_domes() -> Meshes:
    """The same low mesh below parts of a sphere that are larger, so that no ray misses them. They share no UVs."""

    def wider(place: Place) -> Place:
        return lambda s, t: place(1.2 * s - 0.1, 1.2 * t - 0.1)

    high = (Sheet(wider(_dome(turn, 0.06)), WHOLE, 28, 28) for turn in (0.0, 180.0))
    return pair_of(_low_domes(), mesh_of("high", *high))


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


@functools.cache
def layers() -> Meshes:
    """A floor and a roof close above it, both low and high: rays meet the roof first, and the floor has its own detail."""
    low = mesh_of("low", Sheet(flat(0.0), LEFT, 2, 2), Sheet(flat(0.25), RIGHT, 2, 2))
    high = mesh_of("high", Sheet(wave(0.0), LEFT, 24, 24), Sheet(wave(0.25), RIGHT, 24, 24))
    return pair_of(low, high)


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


@functools.cache
def blocks() -> Meshes:
    """A level low mesh through blocks of several heights."""
    return pair_of(mesh_of("low", Sheet(flat(), WHOLE, 1, 1)), blocks_of(STEPS, HEIGHTS, -0.8))


@functools.cache
def tents() -> Meshes:
    """A level low mesh below flat faces whose edges run across texels."""

    def place(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        x, y = 2.0 * s - 1.0, 2.0 * t - 1.0
        z = 0.08 * np.sin(37.0 * x + 5.0 * y) + 0.05 * np.cos(29.0 * y - 11.0 * x)
        return np.stack([x, y, z], axis=-1)

    sheet = Sheet(place, WHOLE, 7, 7)
    return pair_of(
        mesh_of("low", Sheet(flat(), WHOLE, 1, 1)), Mesh.of_arrays("high", place(*sheet.st), sheet.triangles, sheet.uv)
    )


SPLIT = column(22)


def _tilted(height: float, along: float, across: float, least: float, most: float) -> Place:
    def place(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        points = flat(0.0, least, most)(s, t)
        points[:, 2] = height + along * points[:, 0] + across * points[:, 1]
        return points

    return place


@functools.cache
def tilted() -> Meshes:
    """A level low mesh below two tilted sheets, which are objects of their own, each with two materials."""
    sides = ((0.1, 0.2, -0.1, -1.0, SPLIT), (-0.05, -0.15, 0.12, SPLIT, 1.0))
    highs = []
    for number, side in enumerate(sides, start=1):
        made = mesh_of(f"high {number}", Sheet(_tilted(*side), WHOLE, 1, 2))
        materials = 2 * number - 1 + (np.arange(len(made.triangles)) >= 2)
        highs.append(replace(made, labels=np.stack([np.full_like(materials, number), materials], 1).astype(np.float32)))
    names = tuple(HighMaterial(f"material {number}") for number in range(1, 5))
    return pair_of(mesh_of("low", Sheet(flat(), WHOLE, 1, 1)), *highs, materials=names)


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


def _load(key: str, _tile: int) -> ImagePixels:
    return ImagePixels(image_of(key))


def painted(points: np.ndarray) -> np.ndarray:
    """The attribute (N, 4) at points (N, 3): it changes linearly."""
    x, y = points[:, 0], points[:, 1]
    return np.stack([0.5 + 0.4 * x, 0.5 - 0.3 * y, 0.5 + 0.2 * x + 0.2 * y, np.ones_like(x)], axis=-1)


def _with_layers(mesh: Mesh) -> Mesh:
    layers_ = {
        (UV_LAYER, ""): mesh.uv,
        (ATTRIBUTE, "paint"): painted(mesh.positions)[mesh.vertices].astype(np.float32),
        (TANGENTS, ""): mesh.tangents,
    }
    return replace(mesh, layers=layers_)


LIMITS_OF_MATERIALS = (column(13), column(30))
"""Where one material ends and the next begins."""
IMAGE = ImageFeed("color", extension=Extension.EXTEND)
ROUGH = ImageFeed("color", extension=Extension.EXTEND, channel=1, scale=(0.5,) * 3, offset=(0.25,) * 3)
MATERIALS = (
    HighMaterial("image", {"Base Color": IMAGE, "Roughness": ROUGH, "Metallic": Constant((0.0, 0.0, 0.0, 1.0))}),
    HighMaterial(
        "attribute",
        {
            "Base Color": AttributeFeed("paint"),
            "Roughness": AttributeFeed("paint", channel=2),
            "Metallic": AttributeFeed("paint", channel=0),
        },
    ),
    HighMaterial(
        "constant",
        {
            "Base Color": Constant((0.8, 0.1, 0.3, 1.0)),
            "Roughness": Constant((0.7, 0.7, 0.7, 1.0)),
            "Metallic": Constant((1.0, 1.0, 1.0, 1.0)),
        },
    ),
)
PACKING = Packing(
    "packed", (Channel("ROUGHNESS"), Channel("METALLIC"), Channel("ROUGHNESS", is_inverted=True), Channel(constant=1.0))
)


@functools.cache
def colored() -> Meshes:
    """A level sheet with three materials, of an image, an attribute and constants."""
    first, second = (0.5 + 0.5 * x for x in LIMITS_OF_MATERIALS)
    edges, sheets = (0.0, first, second, 1.0), []
    u0, v0, u1, v1 = WHOLE
    for left, right in zip(edges, edges[1:], strict=False):
        part = (u0 + (u1 - u0) * left, v0, u0 + (u1 - u0) * right, v1)
        sheets.append(Sheet(flat(0.02, 2.0 * left - 1.0, 2.0 * right - 1.0), part, 1, 1))
    high = _with_layers(mesh_of("high", *sheets))
    labels = np.stack([np.ones(6), np.repeat((1, 2, 3), 2)], axis=1).astype(np.float32)
    low = mesh_of("low", Sheet(flat(), WHOLE, 1, 1))
    return pair_of(low, replace(high, labels=labels), materials=MATERIALS, load_image=_load)


DETAIL = BumpFeed(
    ImageFeed("bumps", extension=Extension.EXTEND, channel=0),
    strength=0.8,
    distance=0.05,
    below=NormalMapFeed(ImageFeed("normals", extension=Extension.EXTEND)),
)


@functools.cache
def bumpy() -> Meshes:
    """A level sheet with a normal map and a bump map of its own."""
    high = _with_layers(mesh_of("high", Sheet(flat(0.02), WHOLE, 2, 2)))
    labels = np.ones((len(high.triangles), 2), np.float32)
    material = HighMaterial("bumpy", detail=DETAIL)
    low = mesh_of("low", Sheet(flat(), WHOLE, 1, 1))
    return pair_of(low, replace(high, labels=labels), materials=(material,), load_image=_load)


CUT = 0.3
"""The x of a UV seam."""
CUT_LEFT, CUT_RIGHT = box(5.25, 21.75, 5.25, 42.75), box(31.25, 31.25 + 16.5 * (1.0 - CUT) / (1.0 + CUT), 5.25, 42.75)


@functools.cache
def cut() -> Meshes:
    """A level low mesh whose UVs are two islands of the same scale, below a sheet with an attribute."""
    halves = Sheet(flat(0.0, -1.0, CUT), CUT_LEFT, 1, 1), Sheet(flat(0.0, CUT, 1.0), CUT_RIGHT, 1, 1)
    low = mesh_of("low", *halves)
    # Both halves share the vertices of the seam.
    numbers = np.array([0, 1, 2, 3, 1, 4, 3, 5], np.int32)
    joined = np.zeros((6, 3), np.float32)
    joined[numbers] = low.positions
    low = replace(low, positions=joined, vertices=numbers[low.vertices])
    high = _with_layers(mesh_of("high", Sheet(flat(0.05), WHOLE, 3, 3)))
    return pair_of(low, replace(high, labels=np.ones((len(high.triangles), 2), np.float32)), materials=MATERIALS[1:2])


@functools.cache
def tiled() -> Meshes:
    """Waves on two UDIM tiles, 1002 and 1011."""
    (u0, v0, u1, v1), sheets = WHOLE, []
    for height, (right, up) in ((0.0, (1, 0)), (0.25, (0, 1))):
        place = (u0 + right, v0 + up, u1 + right, v1 + up)
        sheets.append((Sheet(flat(height), place, 1, 1), Sheet(wave(height), place, 20, 20)))
    lows, highs = zip(*sheets, strict=True)
    return pair_of(mesh_of("low", *lows), mesh_of("high", *highs))


# What is measured


FLAT_COLOR = np.array([0.5, 0.5, 1.0, 1.0], np.float32)
TILTED_COLOR = np.array([0.68, 0.36, 0.9, 1.0], np.float32)
WHOLE_BAND = Band(0, SIZE, (SIZE, SIZE), 0)


ANGLES = "median", "percentile_95", "percentile_99", "maximum"


def _deviations(meshes: Meshes, run: Run) -> Task[Maps]:
    """The median, two percentiles and the largest angle, if the low mesh had a map of flat normals."""
    in_order = stacked_uvs.ordered(meshes, [FIRST], run.settings.sampling)
    plan = choose_method(in_order, [FIRST], run.settings.tracing)
    source = yield from normal_source(plan, run)
    drawn = maps_of_bake(in_order, source, run)
    hidden = stacked_uvs.StackedParts(plan, source, run.settings, is_shared=in_order is not meshes)
    measured = Deviations(
        plan, drawn, run.settings, kept=lambda texels: np.full_like(texels, FLAT_COLOR), is_wanted=True, hidden=hidden
    )
    measured.add(FIRST, (np.zeros((SIZE, SIZE, 4), np.float32), np.full((SIZE, SIZE), WRITTEN, np.uint8)))
    results = measured.results()
    numbers = np.array([[results[name] for name in ANGLES]], np.float32)
    texels = np.repeat(numbers[..., None], 4, axis=-1)
    return {"angles": (texels, np.full(numbers.shape, WRITTEN, np.uint8))}


def _engine_angles(meshes: Meshes, run: Run) -> Task[Maps]:
    """The angles of a map of one color, made for Cycles, where a program normalizes all vectors."""
    low = meshes.low
    uploaded = mesh_upload.upload(low.triangles, uv=low.uv, normal=low.normals, tangent=low.tangents)
    texture = data_texture.image(np.broadcast_to(TILTED_COLOR, (SIZE, SIZE, 4)))
    axes = normal_space.channels(run.settings.map)
    own, other = (lit.reading(lit.TANGENT + each.flags, axes) for each in (bases.CYCLES, bases.NORMALIZED))
    yield from ()
    angles = audit.measure_engine_angles(uploaded, texture, WHOLE_BAND.uv_to_clip, own, other)
    return {"angles": (np.repeat(angles[..., None], 4, axis=-1), np.where(angles >= 0.0, WRITTEN, 0).astype(np.uint8))}


def _packed(meshes: Meshes, run: Run) -> Task[Maps]:
    """As `_baked`, with the packed image of these maps."""
    maps = yield from _baked(meshes, run)
    encoded = {name: texels for name, (texels, _) in maps.items()}
    return maps | {"packed": (value_encoding.packed(PACKING, encoded), maps["ROUGHNESS"][1])}


FLATTEN, CAST = {"method": Method.FLATTEN}, {"method": Method.CAST}
RAYS = 64
ONE_RAY = 1.0 / RAYS
_OF_RAYS = {
    # A ray that grazes an edge may miss it. Few do.
    "AO": Limit(1e-3, 0.02, 4.5 * ONE_RAY),
    "BENT_NORMAL": Limit(0.1, 0.02, 8.0),
    "THICKNESS": Limit(1e-3, 0.02, 4.5 * ONE_RAY),
    "CURVATURE": Limit(1e-3, 0.02, 4.5 * ONE_RAY),
}
_OF_POINTS = {"HEIGHT": EXACT, "DISTANCE": EXACT, "DISPLACEMENT": EXACT, "POSITION": EXACT}
_OF_POINTS |= dict.fromkeys(("OBJECT_ID", "MATERIAL_ID", "COVERAGE"), Limit(1e-3))
_LOOKED_UP = Limit(2e-4)
"""Places in images are rounded to about 1e-6, of pixels that differ by up to 1."""
_OF_COLORS = {"BASE_COLOR": _LOOKED_UP, "ROUGHNESS": _LOOKED_UP, "METALLIC": _LOOKED_UP}
_PLAIN = {"NORMAL": SNAPPED}


def _in_basis(basis: bases.Basis, method: dict[str, Any]) -> dict[str, Any]:
    return {**method, "space": Space.TANGENT, "basis": basis.name, "directions": "SMOOTH"}


PAIRS = (
    *(Pair(f"Flatten, {basis.label}", domes, _in_basis(basis, FLATTEN), _PLAIN) for basis in bases.BASES),
    *(Pair(f"Cast, {basis.label}", wide_domes, _in_basis(basis, CAST), _PLAIN) for basis in bases.BASES),
    # Rays start above the roof.
    Pair("Own hits under a roof", layers, {**CAST, "extrusion": 0.5, "max_distance": 1.0}, _PLAIN),
    Pair("Adaptive samples", tents, {**CAST, "samples": 64}, {"NORMAL": Limit(0.05, 0.01, 2.0)}),
    Pair("Rays from hits", blocks, {**CAST, "samples": 4, "rays": RAYS}, {"NORMAL": Limit(0.05), **_OF_RAYS}),
    Pair("Points and labels", tilted, CAST, {"NORMAL": SNAPPED, **_OF_POINTS}),
    Pair("Materials", colored, FLATTEN, {**_OF_COLORS, "packed": _LOOKED_UP}, _packed),
    Pair("Own normal and bump maps", bumpy, FLATTEN, {"NORMAL": Limit(0.05)}),
    Pair(
        "Margin across seams", cut, {**CAST, "margin": 4, "margin_type": "ADJACENT_FACES"}, {"BASE_COLOR": _LOOKED_UP}
    ),
    Pair("Margin of the nearest", cut, {**CAST, "margin": 6}, {"BASE_COLOR": _LOOKED_UP}),
    Pair("UDIM tiles", tiled, {**FLATTEN, "udim": True}, _PLAIN),
    Pair("Deviation", domes, _in_basis(bases.MIKKTSPACE, FLATTEN), {"angles": Limit(0.02)}, _deviations),
    Pair("Angles of another engine", domes, _in_basis(bases.CYCLES, FLATTEN), {"angles": Limit(0.02)}, _engine_angles),
)


# Answers


@dataclass(frozen=True)
class Answer:
    """What a map should be.

    values: (H, W, channels) as the maps have them, with as many channels as matter. states: (H, W) uint8. is_compared: the
    texels (H, W) bool that have one right value; None for all.
    """

    values: np.ndarray
    states: np.ndarray
    is_compared: np.ndarray | None = None

    @property
    def is_known(self) -> np.ndarray:
        """The texels (H, W) bool whose values count."""
        written = self.states > 0
        return written if self.is_compared is None else written & self.is_compared


ROUNDED = {"degrees": 4e-3, "": 4e-5}
"""What storing an answer in 16 bits may change."""


def compare(pair: Pair, name: str, answer: Answer, found: Map) -> Outcome:
    """What the map `name` of a pair says of the GPU."""
    (texels, states), limit = found, pair.limit(name)
    of_map = BY_NAME.get(name.partition(" ")[0])
    title = f"{pair.name}: {name if of_map is None else name.replace(of_map.name, of_map.label.lower())}"
    if states.shape != answer.states.shape:
        return Outcome(title, Verdict.WRONG, f"{states.shape} texels, not {answer.states.shape}")
    is_normal = of_map is not None and of_map.kind is Kind.NORMAL
    unit = "degrees" if is_normal or name == "angles" else ""
    known = answer.is_known
    with np.errstate(invalid="ignore"):
        values, wanted = texels[known].astype(np.float64), answer.values[known].astype(np.float64)
        values = values[:, : wanted.shape[1]]
        apart = _degrees(values, wanted) if is_normal else np.abs(values - wanted).max(axis=1)
    apart = np.where(np.isfinite(apart), apart, np.inf)
    moved = int(np.count_nonzero((states != answer.states) & (answer.is_compared is None or answer.is_compared)))
    differing = int(np.count_nonzero(apart > ROUNDED[unit])) + moved
    off, worst = np.count_nonzero(apart > limit.off), float(apart.max(initial=0.0))
    is_wrong = moved > 0 or off > limit.share * len(apart) or worst > limit.most
    verdict = Verdict.WRONG if is_wrong else Verdict.WITHIN if differing else Verdict.EQUAL
    note = f"{moved} are covered here and not there" if moved else ""
    if off and is_wrong:
        note = f"{note}{', ' if note else ''}{off:,} by more than {limit.off:g}"
    return Outcome(title, verdict, note, differing, states.size, worst, unit)


def _degrees(values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Between normals (N, 3) as maps store them."""
    first, second = (2.0 * each - 1.0 for each in (values, wanted))
    first, second = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (first, second))
    return np.degrees(2.0 * np.arcsin(np.minimum(np.linalg.norm(first - second, axis=1) / 2.0, 1.0)))


STEPS_OF_ANSWERS = 65535


def write_answers(answers: Mapping[str, Mapping[str, Answer]]) -> None:
    """Store answers by pair and map, in 16 bits between the least and the largest value of each."""
    arrays = {}
    for pair, maps in answers.items():
        for name, answer in maps.items():
            known = answer.values[answer.is_known]
            low, high = float(known.min(initial=0.0)), float(known.max(initial=0.0))
            scaled = (answer.values - low) / ((high - low) or 1.0) * STEPS_OF_ANSWERS
            scaled = np.where(answer.is_known[..., None], np.clip(np.round(scaled), 0, STEPS_OF_ANSWERS), 0)
            key = f"{pair}: {name}"
            # Channel after channel, and of each the changes along rows: smooth maps become small numbers.
            changes = np.diff(scaled.astype(np.uint16), axis=1, prepend=np.uint16(0))
            arrays[f"{key}/values"] = np.ascontiguousarray(np.moveaxis(changes, -1, 0))
            arrays[f"{key}/range"] = np.array([low, high])
            arrays[f"{key}/states"] = answer.states
            if answer.is_compared is not None:
                arrays[f"{key}/compared"] = np.packbits(answer.is_compared)
    np.savez_compressed(ANSWERS, **arrays)


def answers_of(pair: Pair) -> dict[str, Answer]:
    """The answers of a pair, by map."""
    start = f"{pair.name}: "
    return {key.removeprefix(start): found for key, found in _answers().items() if key.startswith(start)}


@functools.cache
def _answers() -> dict[str, Answer]:
    """By pair and map, as "pair: map"."""
    found = {}
    with np.load(ANSWERS) as arrays:
        for key in (name.removesuffix("/values") for name in arrays.files if name.endswith("/values")):
            scaled = np.cumsum(np.moveaxis(arrays[f"{key}/values"], 0, -1), axis=1, dtype=np.uint16)
            (low, high), states = arrays[f"{key}/range"], arrays[f"{key}/states"]
            compared = None
            if f"{key}/compared" in arrays:
                compared = (
                    np.unpackbits(arrays[f"{key}/compared"], count=states.size).reshape(states.shape).astype(bool)
                )
            found[key] = Answer(low + scaled * ((high - low) / STEPS_OF_ANSWERS), states, compared)
    return found
