# SPDX-License-Identifier: GPL-3.0-or-later
"""Accuracy and speed on surfaces with known normals."""

import bpy
import numpy as np

from scripts.bench import bakers, scenes
from scripts.bench.bakers import Imprint
from scripts.bench.comparing import CAST, FLATTEN
from scripts.bench.parts.pairs import row_of
from scripts.bench.versions import ChildError
from tests.support import angles

RIM = 2
"""Texels at the border of the map that are not compared: bakers differ in which of them they write."""


def closed_forms(quick: bool, repeats: int) -> list[dict]:
    """Measure times, and degrees from the truth, on surfaces with known normals, in world space, on the same texels."""
    size, n = (512, 256) if quick else (1024, 512)
    rows = []
    for build in (scenes.sine, scenes.belt):
        pair = build(n)
        field = [
            Imprint(FLATTEN, pair, size, method="FLATTEN", space="WORLD"),
            Imprint(CAST, pair, size, method="CAST", space="WORLD"),
            bakers.cycles(pair, size, space="OBJECT"),
        ]
        rows.append(_with_angles(pair, size, field, repeats))
    return [*rows, *multires(quick, repeats)]


def multires(quick: bool, repeats: int) -> list[dict]:
    """The same on a sculpted terrain of 524,288 triangles, against Blender's multires bake."""
    pair, sculpt = scenes.multires(9)
    return [_multires(pair, sculpt, size, repeats) for size in ((512,) if quick else (512, 1024, 2048))]


def _multires(pair: scenes.Pair, sculpt: bpy.types.Object, size: int, repeats: int) -> dict:
    field = [Imprint(FLATTEN, pair, size, method="FLATTEN", space="WORLD"), bakers.multires(sculpt, size)]
    return _with_angles(pair, size, field, repeats)


def _with_angles(pair: scenes.Pair, size: int, field: list[bakers.Contender], repeats: int) -> dict:
    timed = bakers.race(field, repeats)
    degrees = {}
    for contender in field:
        if timed[contender.name].gap:
            continue
        try:
            degrees[contender.name] = deviation(pair, contender.normals())
        except ChildError as error:
            timed[contender.name].gap = str(error)
    return row_of(pair, size, timed) | {"angles": degrees}


def deviation(pair: scenes.Pair, normals: np.ndarray) -> dict[str, float]:
    """Degrees from the known normals: median, 99th percentile and maximum; and the share of texels that were written."""
    size = len(normals)
    centers = (np.arange(size) + 0.5) / size
    truth = pair.truth(*np.meshgrid(centers, centers))
    inside = np.s_[RIM:-RIM, RIM:-RIM]
    lengths = np.linalg.norm(normals[inside], axis=-1)
    written = lengths > 0.5
    found = normals[inside][written] / lengths[written][:, None]
    degrees = angles.degrees(found, truth[inside][written])
    median, high, most = np.percentile(degrees, (50, 99, 100)).tolist() if written.any() else (float("nan"),) * 3
    return {"median": median, "percentile_99": high, "maximum": most, "written": float(written.mean())}
