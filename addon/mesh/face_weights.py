# SPDX-License-Identifier: GPL-3.0-or-later
"""Weighs the triangles of a surface by how much a viewer sees of it if a coarse mesh lies beside them."""

import numpy as np

from . import edges
from .triangles import angles_between, unit_normals

UNBENT_WEIGHT = 0.1
"""The weight of triangles without a bend, where the mean bend has about 1: the map hides how far away they are, but outlines
show it."""
BEND_POWER = 0.5
"""The power of the bend. For 1, coarse triangles would have equal errors where surfaces bend in both directions alike; lower
ones allow for outlines, and measured errors correct the rest."""
ERROR_POWER = 0.6
"""The power of the measured errors: with 1, weights swing from one round to the next."""
LEAST_EXCESS, MOST_EXCESS = 0.05, 20.0
"""The measured errors, as factors on their mean, beyond which they count as these."""
SPREADS, SHARE = 3, 0.1
"""How often values are spread to neighbors, and which share of its neighbors' sum a vertex gets each time."""


def by_bending(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Weights (T,), higher where the surface bends: there, a shift of the coarse mesh shows other normals.

    Args:
        points: (V, 3) float32.
        triangles: (T, 3) int, with areas above 0.
    """
    corners = points[triangles].astype(np.float64)
    ahead = np.roll(corners, -1, axis=1)
    along = ahead - corners
    normals, twice_areas = unit_normals(ahead)
    across = edges.neighbors(points, triangles)
    angles = angles_between(normals[:, None], normals[across])
    bends = (np.where(across >= 0, angles, 0.0) * np.linalg.norm(along, axis=2)).sum(axis=1)
    vertices, count = triangles.reshape(-1), len(points)
    around = np.bincount(vertices, np.repeat(bends, 3), count)
    around /= np.maximum(np.bincount(vertices, np.repeat(twice_areas, 3), count), 1e-300)
    mean = max(float(bends.sum() / max(twice_areas.sum(), 1e-300)), 1e-300)
    return UNBENT_WEIGHT + (around[triangles].mean(axis=1) / mean) ** BEND_POWER


def by_error(weights: np.ndarray, triangles: np.ndarray, places: np.ndarray, excess: np.ndarray) -> np.ndarray:
    """Weights (T,) that give each triangle of the next coarse mesh an error that is more like that of the others.

    Args:
        weights: (T,), by which the coarse mesh was made.
        triangles: (T, 3) int.
        places: (N,) int, the triangles of places that were looked at.
        excess: (N,), the error of the whole triangle of the coarse mesh that is nearest to each place, over the mean of all.
    """
    logarithms = np.log(np.clip(excess, LEAST_EXCESS, MOST_EXCESS))
    of_faces = np.stack(
        [np.bincount(places, logarithms, len(triangles)), np.bincount(places, minlength=len(triangles))]
    )
    vertices, count = triangles.reshape(-1), int(triangles.max(initial=-1)) + 1

    def gathered(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(vertices, np.repeat(row, 3), count) for row in values])

    of_vertices = gathered(of_faces)
    for _ in range(SPREADS):
        of_vertices += SHARE * gathered(of_vertices[:, triangles].sum(axis=2))
    sums, counts = of_vertices[:, triangles].sum(axis=2)
    return weights * np.exp(ERROR_POWER * np.divide(sums, counts, out=np.zeros_like(sums), where=counts > 0.0))
