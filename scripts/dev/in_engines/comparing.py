# SPDX-License-Identifier: GPL-3.0-or-later
"""What an engine shows of each map, in degrees from what it shows of the object-space map."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from addon.core.declarations import bases
from scripts.dev.in_engines import chromium, drawing
from scripts.dev.in_engines.glb_file import unit
from scripts.dev.in_engines.samples import Sample
from tests.support import angles

DIRECTIONS = ((0.4, 0.3, 1.0), (-0.5, -0.2, -1.0))
"""From the mesh to the eyes, in the axes of glTF: before it and behind it."""
BARE, OBJECT, NO_TANGENTS = "bare", "object", "no-tangents"


@dataclass(frozen=True)
class View:
    """What one eye sees, on the pixels where a mesh is: bottom row first.

    matrix: of the camera. away: (S, S), whether the four texels around a pixel are baked and have its sign: so it
    lies away from the borders of islands, mirrored seams, and texels that several triangles share.
    """

    matrix: np.ndarray
    away: np.ndarray


@dataclass(frozen=True)
class Setting:
    """The eyes around a sample, and their lens."""

    views: list[View]
    near: float
    far: float


def set_up(sample: Sample, size: int) -> Setting:
    """The views of a sample that show all of it, in pictures of size x size pixels."""
    sights = drawing.look_around(sample.surface.position, DIRECTIONS, size)
    seen = zip(sights.matrices, sights.drawn, strict=True)
    views = [View(matrix, away_from_seams(sample, drawn)) for matrix, drawn in seen]
    return Setting(views, sights.near, sights.far)


def away_from_seams(sample: Sample, drawn: drawing.Drawn) -> np.ndarray:
    """View.away of a view."""
    triangle, weights = drawn.triangle[drawn.there], drawn.weights[drawn.there]
    uv = np.einsum("ncx,nc->nx", sample.uv[triangle], weights)
    columns, rows = drawing.footprint(uv, len(sample.object_map))
    laid_out, signs = sample.laid_out, sample.surface.tangent[:, 0, 3]
    own = sample.baked[rows, columns] & (signs[laid_out.triangle[rows, columns]] == signs[triangle][:, None])
    found = np.zeros(drawn.triangle.shape, bool)
    found[drawn.there] = own.all(axis=1) & ((uv >= 0.0) & (uv < 1.0)).all(axis=1)
    return found


def models(sample: Sample, setting: Setting, engine: str) -> list[chromium.Model]:
    """The files for an engine: without a map, with the map of each basis, in object space, and without tangents."""
    files = {basis: glb.copy() for basis, glb in sample.files.items()}
    for glb in files.values():
        glb.set_cameras([view.matrix for view in setting.views], drawing.ANGLE, setting.near, setting.far)
    other = files["MIKKTSPACE"]
    own = other.copy()
    own.set_image(own.normal_texture(), drawing.png(sample.object_map))
    shown = own.with_map_as_surface() if engine in chromium.WITHOUT_OBJECT_SPACE else own
    found = {**files, BARE: other.without_normal_map(), NO_TANGENTS: other.without_tangents()}
    tangent = [chromium.Model(name, glb.content()) for name, glb in found.items()]
    return [*tangent, chromium.Model(OBJECT, shown.content(), "object")]


def run(sample: Sample, setting: Setting, modules: Path, engine: str, size: int) -> dict:
    """Draw a sample in an engine: by name of the model and view, world-space normals (size, size, 3), 0 where nothing is."""
    found = {}

    def keep(name: str, view: int, _output: str, pixels: np.ndarray) -> None:
        normals = unit(pixels[..., :3].astype(np.float64) * 2.0 - 1.0)
        if name == OBJECT and engine in chromium.WITHOUT_OBJECT_SPACE:
            normals = unit(normals @ sample.normal_matrix.T)
        found[name, view] = np.where(pixels[..., 3:] > 0.5, normals, 0.0).astype(np.float32)

    files = models(sample, setting, engine)
    chromium.render(modules, engine, files, views=len(setting.views), size=size, keep=keep)
    return found


def degrees(found: dict, setting: Setting) -> dict:
    """The 99th percentile of the angles of each model to the object-space map, and how many pixels it is of."""
    angles_of = {name: [] for name in (*bases.BY_NAME, NO_TANGENTS, BARE)}
    for index, view in enumerate(setting.views):
        away = view.away & found[BARE, index].any(axis=-1)
        for name, parts in angles_of.items():
            parts.append(angles.degrees(found[name, index][away], found[OBJECT, index][away]))
    joined = {name: np.concatenate(parts) for name, parts in angles_of.items()}
    return {
        "compared": len(joined[BARE]),
        "degrees": {name: round(float(np.percentile(values, 99)), 4) for name, values in joined.items()},
    }
