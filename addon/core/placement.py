# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounding boxes of low and high meshes explain what other programs wrote: other units, other axes, rounded coordinates."""

import math
from collections.abc import Iterable

import numpy as np

UNITS = (10.0, 100.0, 1000.0, 0.3048, 0.0254)
"""Ratios between units that programs mix up: meters to deci-, centi- and millimeters, feet and inches."""
ALIKE = 0.05
"""How much the sides of a low and a high mesh may differ. A simplified mesh is a little smaller."""
FLAT = 0.01
"""A side this much shorter than the longest one is not compared: the meshes may be flat."""
FAR = 10.0
"""A distance in diagonals at which meshes belong to different coordinate systems."""
COARSE = 1e-5
"""The steps of single precision as a share of a mesh's size, above which its details suffer."""


def hint(low: np.ndarray, high: np.ndarray) -> str:
    """Why two meshes may not fit, as a sentence; empty if nothing is known. low, high: the boxes (2, 3), in one space."""
    low_sides, high_sides = low[1] - low[0], high[1] - high[0]
    diagonal = float(np.linalg.norm(high_sides))
    if not (low_sides.any() and high_sides.any() and np.isfinite([*low_sides, *high_sides]).all()):
        return ""
    for unit in (*UNITS, *(1.0 / unit for unit in UNITS)):
        if _are_alike(low_sides * unit, high_sides):
            times = unit if unit > 1.0 else 1.0 / unit
            return (
                f"The high mesh is {times:.4g} times as {'large' if unit > 1.0 else 'small'} as the low one: "
                "they seem to have different units. Export both with the same unit."
            )
    if not _are_alike(low_sides, high_sides) and _are_alike(low_sides[[0, 2, 1]], high_sides):
        return (
            "The high mesh seems to be turned by 90 degrees about X: one of the files has Z up where its format has Y up. "
            "Export both with the same axis up."
        )
    distance = float(np.linalg.norm(np.maximum(np.maximum(low[0] - high[1], high[0] - low[1]), 0.0)))
    if distance > FAR * max(diagonal, float(np.linalg.norm(low_sides))):
        centers = (_place(low.mean(axis=0)), _place(high.mean(axis=0)))
        return (
            f"The low mesh lies around {centers[0]} and the high one around {centers[1]}: "
            "they seem to be exported with different offsets."
        )
    return ""


def rounding(box: np.ndarray, location: np.ndarray) -> str:
    """A sentence about coordinates that single precision has rounded; empty if the mesh is near the origin.

    box (2, 3): of the mesh, in its object's space. location (3,): of the object.
    """
    size = float(np.linalg.norm(box[1] - box[0]))
    # Whole numbers are exact: they are offsets that were chosen to be.
    inexact = location[location != np.round(location)]
    largest = max(np.abs(box).max(), np.abs(inexact).max(initial=0.0))
    if not (np.isfinite(largest) and size > 0.0):
        return ""
    step = float(np.spacing(np.float32(largest)))
    if step <= COARSE * size:
        return ""
    return (
        f"lies {largest:.3g} from its origin, where single precision rounds coordinates to {step:.2g}. "
        "Export it with an offset, or as .obj, or as .ply in double precision."
    )


def _are_alike(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two boxes have the same sides (3,), nearly."""
    longest = max(first.max(), second.max())
    matters = np.maximum(first, second) > FLAT * longest
    return bool((np.abs(first - second) <= ALIKE * np.maximum(first, second))[matters].all())


def _place(point: Iterable[float]) -> str:
    return f"({', '.join(f'{value:.6g}' if math.isfinite(value) else '?' for value in point)})"
