# SPDX-License-Identifier: GPL-3.0-or-later
"""A wavy sheet of known shape and colors, and how far what an engine shows of a file of it is from them.

The sheet stands over the square -1..1 of x and y, in the axes of glTF, and rises along z towards the eye. A point of a low
mesh shows the point of the high one with the same x and y.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from scripts.dev.in_engines import chromium, drawing
from scripts.dev.in_engines.glb_file import Glb, Surface, unit
from tests.support import angles

NORMAL_LIMIT = 1.0
"""Degrees at the 99th percentile."""
VALUE_LIMIT = 0.01
"""Of a channel, at the 99th percentile. A step of 8 bits in sRGB is up to 0.009 of a linear value."""
AWAY = 0.1
"""How far from x = 0, where the colors change, they are compared."""
TOWARDS = (0.0, 0.0, 1.0)
"""From the sheet to the eye."""
BULGE, BULGE_X, BULGE_Y = 0.35, 1.3, 1.1
WAVE, WAVE_X, WAVE_Y = 0.02, 9.0, 8.0


@dataclass(frozen=True)
class Side:
    """The half of the high mesh with x below or above 0. color: linear."""

    name: str
    color: tuple[float, float, float]
    roughness: float
    metallic: float


SIDES = Side("left", (0.5, 0.1, 0.02), 0.25, 0.75), Side("right", (0.04, 0.2, 0.6), 0.6, 0.1)


@dataclass(frozen=True)
class Case:
    """A low mesh of the sheet as it was exported.

    outputs: what to draw, of chromium.OUTPUTS. has_sides: whether the halves have colors of their own, and not those of the
    right one. surfaces: occlusion, roughness and metallic of each part, (H, W, 4), bottom row first.
    """

    name: str
    outputs: tuple[str, ...] = (chromium.NORMAL, chromium.COLOR)
    has_sides: bool = True
    glb: Glb | None = None
    surfaces: list[np.ndarray] = field(default_factory=list)


def coarse(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The height of the low meshes' vertices."""
    return BULGE * np.cos(BULGE_X * x) * np.cos(BULGE_Y * y)


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The height of the high mesh."""
    return coarse(x, y) + WAVE * np.cos(WAVE_X * x) * np.cos(WAVE_Y * y)


def normals(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The normals (N, 3) of the high mesh, in closed form."""
    waves = (BULGE, BULGE_X, BULGE_Y), (WAVE, WAVE_X, WAVE_Y)
    along_x = sum(size * a * np.sin(a * x) * np.cos(b * y) for size, a, b in waves)
    along_y = sum(size * b * np.cos(a * x) * np.sin(b * y) for size, a, b in waves)
    return unit(np.stack([along_x, along_y, np.ones_like(x)], axis=-1))


def values(case: Case, x: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """What the sides at x (N,) have of these fields: (N, numbers)."""
    rows = [np.hstack([getattr(side, name) for name in names]) for side in SIDES]
    return np.array(rows)[(x > 0.0).astype(int) if case.has_sides else np.ones(len(x), int)]


def follow_their_uv(surface: Surface) -> bool:
    """Whether all tangents point along u, and all bitangents along v (upwards), by less than 45 degrees."""
    if surface.tangent is None:
        return False
    uv = np.stack([surface.uv[..., 0], 1.0 - surface.uv[..., 1]], axis=-1)
    sides = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=1)
    edges = surface.position[:, 1:] - surface.position[:, :1]
    along_u, along_v = np.moveaxis(np.linalg.solve(sides, edges), 1, 0)[:, :, None]
    tangent = surface.tangent[..., :3]
    bitangent = surface.tangent[..., 3:] * np.cross(surface.normal, tangent)
    cosines = [(unit(a) * unit(b)).sum(axis=-1).min() for a, b in ((tangent, along_u), (bitangent, along_v))]
    return bool(min(cosines) > np.sqrt(0.5))


def are_loaded(glb: Glb, loaded: list[list[float] | None]) -> bool:
    """Whether an engine has loaded the tangents of a file, in whatever order. loaded: by part, four numbers each."""
    parts = [part["attributes"].get("TANGENT") for mesh in glb.document["meshes"] for part in mesh["primitives"]]
    if len(loaded) != len(parts) or None in parts or None in loaded:
        return False
    wanted, found = np.concatenate([glb.accessor(one) for one in parts]), np.concatenate(loaded).reshape(-1, 4)
    between = np.abs(wanted[:, None] - found[None]).max(axis=-1)
    return bool(max(between.min(axis=0).max(), between.min(axis=1).max()) < 1e-5)


def run(cases: list[Case], modules: Path, engine: str, pixels: int) -> list[dict]:
    """Draw all cases in an engine. Returns the figures of each."""
    drawn, models, found = {}, [], {case.name: {} for case in cases}
    for case in cases:
        sights = drawing.look_around(case.glb.surface().position, [TOWARDS], pixels)
        glb = case.glb.copy()
        glb.set_cameras(sights.matrices, drawing.ANGLE, sights.near, sights.far)
        (drawn[case.name],) = sights.drawn
        models.append(chromium.Model(case.name, glb.content(), outputs=case.outputs))

    def keep(name: str, _view: int, output: str, picture: np.ndarray) -> None:
        found[name][output] = picture

    loaded = chromium.render(modules, engine, models, views=1, size=pixels, keep=keep)
    return [
        {"case": case.name} | figures(case, drawn[case.name], found[case.name], loaded[case.name]) for case in cases
    ]


def figures(case: Case, drawn: drawing.Drawn, found: dict[str, np.ndarray], loaded: list[list[float] | None]) -> dict:
    """What an engine shows of a case. found: pictures (S, S, 4), by output. loaded: the tangents, by part.

    tangents: whether the file's tangents follow the UVs of its maps, and are loaded. normal, color, surface: at the 99th
    percentile, degrees and differences from what is known.
    """
    surface = case.glb.surface()
    there = drawn.there & (found[chromium.NORMAL][..., 3] > 0.5)
    triangle, weights = drawn.triangle[there], drawn.weights[there]
    x, y, _ = np.einsum("ncx,nc->nx", surface.position[triangle], weights).T
    shown = unit(found[chromium.NORMAL][there][:, :3].astype(np.float64) * 2.0 - 1.0)
    known = {chromium.COLOR: values(case, x, ("color",))}
    if case.surfaces:
        uv = np.einsum("ncx,nc->nx", surface.uv[triangle], weights)
        known[chromium.SURFACE] = values(case, x, ("roughness", "metallic"))
        occlusion = looked_up(case, triangle, np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=-1))
        known[chromium.SURFACE] = np.column_stack([occlusion, known[chromium.SURFACE]])
    away = np.abs(x) > AWAY
    off = {name: np.abs(found[name][there][:, :3] - wanted).max(axis=-1)[away] for name, wanted in known.items()}
    return {
        "pixels": int(np.count_nonzero(there)),
        "tangents": follow_their_uv(surface) and are_loaded(case.glb, loaded),
        "normal": round(float(np.percentile(angles.degrees(shown, normals(x, y)), 99)), 4),
        **{name: round(float(np.percentile(values, 99)), 4) for name, values in off.items()},
    }


def looked_up(case: Case, triangle: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The red of a case's surfaces (N,) on triangles at uv (N, 2), v up: the mean of four texels, as engines filter."""
    counts = [len(case.glb.accessor(part["indices"])) // 3 for part in case.glb.document["meshes"][0]["primitives"]]
    part = np.repeat(np.arange(len(counts)), counts)[triangle]
    reds = np.stack([texels[..., 0] for texels in case.surfaces])
    size = reds.shape[1]
    columns, rows = drawing.footprint(uv, size)
    right, up = ((uv * size - 0.5) % 1.0).T
    shares = np.stack([(1 - right) * (1 - up), right * (1 - up), (1 - right) * up, right * up], axis=-1)
    return (reds[part[:, None], rows, columns] * shares).sum(axis=-1)


def failures(rows: list[dict]) -> list[str]:
    """What the rows of cases show that they must not."""
    found = []
    for row in rows:
        where = f"{row['case']} in {row['label']}"
        if not row["tangents"]:
            found.append(f"{where}: the tangents of the map's UV layer are not loaded")
        if row["normal"] > NORMAL_LIMIT:
            found.append(f"{where}: normals are off by {row['normal']:.2f} degrees, and not by {NORMAL_LIMIT} at most")
        for name in (chromium.COLOR, chromium.SURFACE):
            if row.get(name, 0.0) > VALUE_LIMIT:
                found.append(f"{where}: {name} is off by {row[name]:.3f}, and not by {VALUE_LIMIT} at most")
    return found
