# SPDX-License-Identifier: GPL-3.0-or-later
"""Small bakes that together use all passes, how much their maps may differ from their answers, and whether they do.

`gpu_answers.npz` has their meshes and images, and what their maps should be. scripts/dev/gpu_answers.py makes it, and says how
each answer is known.
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
from ..engine import baking, normal_space
from ..engine.bands import Band
from ..engine.planning import plan_of
from ..engine.stacked_uvs import StackedParts
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import ATTRIBUTE, TANGENTS, UV_LAYER, Mesh
from ..mesh.triangles import angles_between, unit
from ..output import value_encoding
from ..passes import audit, data_texture, lit, mesh_upload

ANSWERS = Path(__file__).with_name("gpu_answers.npz")
SIZE = 48
"""Texels along each side of a map."""
Maps: TypeAlias = dict[str, Map]
"""Texels and states by name; those of UDIM tiles have the tile's number after the name."""
Arrays: TypeAlias = Mapping[str, np.ndarray]
"""By key, as ANSWERS has them: "meshes/<name>/<number>/<field>", "images/<name>" and "<pair>: <map>/<part>"."""

SHARES = {"curvature_radius": 0.02}
"""Lengths with which the stored answers were made, as shares of the diagonal."""


@dataclass(frozen=True)
class Limit:
    """How far a map may be from its answer."""

    off: float
    """Degrees of a normal, or a difference of a number."""
    share: float = 0.0
    """Of the texels that may differ more, as single rays that graze an edge do."""
    most: float = np.inf
    """What no texel may differ by."""


SNAPPED = Limit(0.05)
"""Degrees. Rasterizers put corners on 1/256 texel, where these normals turn by at most 8 degrees from texel to texel."""
EXACT = Limit(2e-5)
"""Numbers that few roundings make, from 0 to 1."""


@dataclass(frozen=True)
class Pair:
    """One bake of a low mesh and high ones."""

    name: str
    """For the report, and of its answers."""
    meshes: str
    """The name of its meshes in ANSWERS. Several pairs share some."""
    settings: Mapping[str, Any]
    """By their names in `Settings`."""
    limits: Mapping[str, Limit]
    """By map."""
    make: Callable[[Meshes, Run], Task[Maps]] = field(default_factory=lambda: _baked)
    """Bakes."""

    def limit(self, name: str) -> Limit:
        """That of a map; the maps of all UDIM tiles have the same."""
        return self.limits[name.partition(" ")[0]]

    def bake(self, pace: Pace | None = None, stored: Arrays | None = None) -> Task[Maps]:
        """Bake the pair.

        Args:
            pace: of the slices.
            stored: has the meshes and images; those in ANSWERS if it is None.
        """
        maps = tuple(name for name in self.limits if name in BY_NAME and name != "NORMAL")
        usual = {"width": SIZE, "height": SIZE, "margin": 0, "space": Space.WORLD, "maps": maps} | SHARES
        run = Run(Settings(**{**usual, **self.settings}), pace or Pace())
        return (yield from self.make(meshes_of(self.meshes, stored), run))


def _baked(meshes: Meshes, run: Run) -> Task[Maps]:
    tiles = yield from baking.bake(meshes, run)
    if list(tiles) == [FIRST]:
        return tiles[FIRST]
    return {f"{name} {tile}": one_map for tile, maps in tiles.items() for name, one_map in maps.items()}


# Meshes


@functools.cache
def _stored() -> Arrays:
    """All that is in ANSWERS, by key."""
    with np.load(ANSWERS) as arrays:
        return dict(arrays)


IMAGE = ImageFeed("color", extension=Extension.EXTEND)
ROUGH = ImageFeed("color", extension=Extension.EXTEND, channel=1, scale=(0.5,) * 3, offset=(0.25,) * 3)
PAINTED = HighMaterial(
    "attribute",
    {
        "Base Color": AttributeFeed("paint"),
        "Roughness": AttributeFeed("paint", channel=2),
        "Metallic": AttributeFeed("paint", channel=0),
    },
)
COLORED = (
    HighMaterial("image", {"Base Color": IMAGE, "Roughness": ROUGH, "Metallic": Constant((0.0, 0.0, 0.0, 1.0))}),
    PAINTED,
    HighMaterial(
        "constant",
        {
            "Base Color": Constant((0.8, 0.1, 0.3, 1.0)),
            "Roughness": Constant((0.7, 0.7, 0.7, 1.0)),
            "Metallic": Constant((1.0, 1.0, 1.0, 1.0)),
        },
    ),
)
DETAIL = BumpFeed(
    ImageFeed("bumps", extension=Extension.EXTEND, channel=0),
    strength=0.8,
    distance=0.05,
    below=NormalMapFeed(ImageFeed("normals", extension=Extension.EXTEND)),
)
MATERIALS = {
    "tilted": tuple(HighMaterial(f"material {number}") for number in range(1, 5)),
    "colored": COLORED,
    "bumpy": (HighMaterial("bumpy", detail=DETAIL),),
    "cut": (PAINTED,),
}
"""By the name of the meshes."""


def meshes_of(name: str, stored: Arrays | None = None) -> Meshes:
    """Meshes by their name: the low mesh has the number 0, the high ones those from 1 on."""
    stored = _stored() if stored is None else stored
    count = sum(key.startswith(f"meshes/{name}/") and key.endswith("/positions") for key in stored)
    low, *highs = (_mesh(stored, f"meshes/{name}/{number}/") for number in range(count))

    def load(key: str, _tile: int) -> ImagePixels:
        return ImagePixels(stored[f"images/{key}"])

    materials = list(MATERIALS.get(name, ()))
    return replace(Meshes.of(low, []), highs=highs, basis=low, materials=materials, load_image=load)


def _mesh(stored: Arrays, start: str) -> Mesh:
    """The mesh whose keys have this start."""
    has = {key.removeprefix(start): values for key, values in stored.items() if key.startswith(start)}
    paint, vertices = has.pop("paint", None), has.pop("vertices").astype(np.int32)
    triangles = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    faces = np.arange(len(triangles), dtype=np.int32)
    made = Mesh(
        "low" if start.endswith("/0/") else "high",
        vertices=vertices,
        triangles=triangles,
        to_world=np.eye(4),
        faces=faces,
        **has,
    )
    if paint is None:
        return made
    layers = {(UV_LAYER, ""): made.uv, (ATTRIBUTE, "paint"): paint, (TANGENTS, ""): made.tangents}
    return replace(made, layers=layers)


# What is baked


PACKING = Packing(
    "packed", (Channel("ROUGHNESS"), Channel("METALLIC"), Channel("ROUGHNESS", is_inverted=True), Channel(constant=1.0))
)
FLAT_COLOR = np.array([0.5, 0.5, 1.0, 1.0], np.float32)
TILTED_COLOR = np.array([0.68, 0.36, 0.9, 1.0], np.float32)
WHOLE_BAND = Band(0, SIZE, (SIZE, SIZE), 0)


ANGLES = "median", "percentile_95", "percentile_99", "maximum"


def _deviations(meshes: Meshes, run: Run) -> Task[Maps]:
    """The median, two percentiles and the largest angle, if the low mesh had a map of flat normals."""
    drawn = yield from baking.draw(plan_of(meshes, run.settings), run)
    hidden = StackedParts(drawn, run.settings)
    measured = Deviations(drawn, run.settings, hidden=hidden)
    measured.add(FIRST, (np.tile(FLAT_COLOR, (SIZE, SIZE, 1)), np.full((SIZE, SIZE), WRITTEN, np.uint8)))
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
    angles = audit.measure_engine_angles(uploaded, texture, texture, WHOLE_BAND.uv_to_clip, own=own, other=other)
    return {"angles": (np.repeat(angles[..., None], 4, axis=-1), np.where(angles >= 0.0, WRITTEN, 0).astype(np.uint8))}


def _packed(meshes: Meshes, run: Run) -> Task[Maps]:
    """As `_baked`, with the packed image of these maps."""
    maps = yield from _baked(meshes, run)
    return maps | {"packed": (value_encoding.packed(PACKING, maps), maps["ROUGHNESS"][1])}


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
    *(Pair(f"Flatten, {basis.label}", "domes", _in_basis(basis, FLATTEN), _PLAIN) for basis in bases.BASES),
    *(Pair(f"Cast, {basis.label}", "wide_domes", _in_basis(basis, CAST), _PLAIN) for basis in bases.BASES),
    # Rays start above the roof.
    Pair("Own hits under a roof", "layers", {**CAST, "extrusion": 0.5, "max_distance": 1.0}, _PLAIN),
    Pair("Adaptive samples", "tents", {**CAST, "samples": 64}, {"NORMAL": Limit(0.05, 0.01, 2.0)}),
    Pair("Rays from hits", "blocks", {**CAST, "samples": 4, "rays": RAYS}, {"NORMAL": Limit(0.05), **_OF_RAYS}),
    Pair("Points and labels", "tilted", CAST, {"NORMAL": SNAPPED, **_OF_POINTS}),
    # Sums of several maps are made in turn, maps are drawn in between, and own normals are turned by a compute shader.
    Pair("Means of points", "bumpy", {**CAST, "samples": 4}, dict.fromkeys(("POSITION", "HEIGHT", "COVERAGE"), EXACT)),
    Pair("Materials", "colored", FLATTEN, {**_OF_COLORS, "packed": _LOOKED_UP}, _packed),
    Pair("Own normal and bump maps", "bumpy", FLATTEN, {"NORMAL": Limit(0.05)}),
    Pair(
        "Margin across seams", "cut", {**CAST, "margin": 4, "margin_type": "ADJACENT_FACES"}, {"BASE_COLOR": _LOOKED_UP}
    ),
    Pair("Margin of the nearest", "cut", {**CAST, "margin": 6}, {"BASE_COLOR": _LOOKED_UP}),
    Pair("UDIM tiles", "tiled", {**FLATTEN, "udim": True}, _PLAIN),
    Pair("Deviation", "domes", _in_basis(bases.MIKKTSPACE, FLATTEN), {"angles": Limit(0.02)}, _deviations),
    Pair(
        "Angles of another engine", "domes", _in_basis(bases.CYCLES, FLATTEN), {"angles": Limit(0.02)}, _engine_angles
    ),
)


# Answers


@dataclass(frozen=True)
class Answer:
    """What a map should be."""

    values: np.ndarray
    """(H, W, channels) as maps have them, with as many channels as matter."""
    states: np.ndarray
    """(H, W) uint8."""
    is_compared: np.ndarray | None = None
    """The texels (H, W) bool that have one right value; None for all."""

    @property
    def is_known(self) -> np.ndarray:
        """The texels (H, W) bool whose values count."""
        written = self.states > 0
        return written if self.is_compared is None else written & self.is_compared


ROUNDED = {"degrees": 4e-3, "": 4e-5}
"""What storing an answer in 16 bits may change."""


def compare(pair: Pair, name: str, answer: Answer, drawn: Map) -> Outcome:
    """What the map `name` of a pair says of the GPU."""
    (texels, states), limit = drawn, pair.limit(name)
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
    return np.degrees(angles_between(unit(2.0 * values - 1.0), unit(2.0 * wanted - 1.0)))


STEPS = 65535
"""Answers are stored in 16 bits, between the least and the largest value of each."""


def answers_of(pair: Pair) -> dict[str, Answer]:
    """The answers of a pair, by map."""
    start = f"{pair.name}: "
    return {key.removeprefix(start): array for key, array in _answers().items() if key.startswith(start)}


@functools.cache
def _answers() -> dict[str, Answer]:
    """By pair and map, as "pair: map"."""
    arrays, answers = _stored(), {}
    for key in (name.removesuffix("/values") for name in arrays if name.endswith("/values")):
        # Channel after channel, and of each the changes along rows: smooth maps become small numbers.
        scaled = np.cumsum(np.moveaxis(arrays[f"{key}/values"], 0, -1), axis=1, dtype=np.uint16)
        (low, high), states = arrays[f"{key}/range"], arrays[f"{key}/states"]
        compared = arrays.get(f"{key}/compared")
        if compared is not None:
            compared = np.unpackbits(compared, count=states.size).reshape(states.shape).astype(bool)
        answers[key] = Answer(low + scaled * ((high - low) / STEPS), states, compared)
    return answers
