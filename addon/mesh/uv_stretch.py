# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures how well UVs use a map: how much of it, and how evenly."""

from dataclasses import dataclass

import numpy as np

WORST = 100.0
"""The most that a triangle counts for, as a factor on the mean distance between its texels: slivers without area in UV space
would decide alone."""


@dataclass(frozen=True)
class Layout:
    """How UVs use a map.

    used: share of the map that triangles cover, if none overlap. angle: the mean factor between the widest and the narrowest
    distance of texels on the surface; 1 without stretch. area: the mean factor by which the size of texels differs from that
    of all; 1 if all have the same size. sharpness: the share of the map that UVs without stretch would need to be as sharp; at
    most `used`.
    """

    used: float
    angle: float
    area: float
    sharpness: float


def measure(points: np.ndarray, uv: np.ndarray) -> Layout:
    """Measure triangles with points (T, 3, 3) and UVs (T, 3, 2). Those without area on the surface do not count."""
    points, uv = points.astype(np.float64), uv.astype(np.float64)
    u, v = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    surface = 0.5 * np.linalg.norm(np.cross(u, v), axis=1)
    counts = surface > 1e-12 * surface.max(initial=0.0)
    u, v, uv, surface = u[counts], v[counts], uv[counts], surface[counts]
    if not len(surface):
        return Layout(0.0, 1.0, 1.0, 0.0)
    # The triangle in its own plane, so that a 2 x 2 matrix leads from there to UV space.
    length = np.linalg.norm(u, axis=1)
    along = (u * v).sum(axis=1) / length
    flat = np.zeros((len(surface), 2, 2))
    flat[:, 0, 0], flat[:, 0, 1], flat[:, 1, 1] = length, along, 2.0 * surface / length
    edges = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=2)
    most, least = np.moveaxis(np.linalg.svd(edges @ np.linalg.inv(flat), compute_uv=False), 1, 0)
    weights = surface / surface.sum()
    in_uv = 0.5 * np.abs(np.linalg.det(edges))
    used = float(in_uv.sum())
    if used == 0.0:
        return Layout(0.0, 1.0, 1.0, 0.0)
    even = np.sqrt(used / surface.sum())  # the texels by length, if all had the same size
    most, least = np.maximum(most, even / WORST), np.maximum(least, even / WORST)
    size = most * least / even**2
    spacing = 0.5 * (1.0 / most**2 + 1.0 / least**2)
    return Layout(
        used,
        float((weights * most / least).sum()),
        float((weights * np.maximum(size, 1.0 / size)).sum()),
        float(surface.sum() / (weights * spacing).sum()),
    )
