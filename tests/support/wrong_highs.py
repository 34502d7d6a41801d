# SPDX-License-Identifier: GPL-3.0-or-later
"""High meshes that are wrong in all ways at once. All of it follows from a generator of random numbers."""

import numpy as np

from . import spoiled, zoo


def patch(rng):
    """A bumpy sheet over the low plane."""
    n = int(rng.integers(1, 9))
    uv, quads = zoo.grid_uv(n, n), zoo.grid_faces(n, n)
    points = np.column_stack([2.0 * uv - 1.0, 0.1 * rng.random(len(uv))])
    return points, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def moebius(rng):
    count = int(rng.integers(8, 40))
    angle = 2.0 * np.pi * np.arange(count) / count
    way = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    across = np.cos(angle / 2.0)[:, None] * way + np.outer(np.sin(angle / 2.0), (0.0, 0.0, 1.0))
    points = np.concatenate([0.7 * way - 0.2 * across, 0.7 * way + 0.2 * across])
    here, after = np.arange(count), (np.arange(count) + 1) % count
    low, high = np.stack([here, after]), np.stack([here, after]) + count
    low[1, -1], high[1, -1] = high[1, -1], low[1, -1]
    first = np.stack([low[0], low[1], high[1]], axis=1)
    return points, np.concatenate([first, np.stack([low[0], high[1], high[0]], axis=1)])


def fan(rng):
    """Up to thirty triangles at one edge."""
    count = int(rng.integers(3, 31))
    angle = 2.0 * np.pi * np.arange(count) / count
    rim = np.stack([np.cos(angle), np.sin(angle), rng.normal(scale=0.2, size=count)], axis=1)
    points = np.concatenate([[(0.0, 0.0, -0.3), (0.0, 0.0, 0.3)], rim])
    return points, np.stack([np.zeros(count, int), np.ones(count, int), 2 + np.arange(count)], axis=1)


def debris(rng):
    count = int(rng.integers(1, 60))
    points = rng.uniform(-1.0, 1.0, (count, 1, 3)) * (1.0, 1.0, 0.2) + rng.normal(scale=0.05, size=(count, 3, 3))
    return points.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def slivers(rng):
    """Triangles without an area: points, lines, and thin ones."""
    points, triangles = debris(rng)
    points = points.reshape(-1, 3, 3)
    points[:, 2] = points[:, 0] + rng.choice([0.0, 1e-12, 1e-6]) * points[:, 2]
    points[:: 1 + int(rng.integers(1, 4)), 1] = points[:: 1 + int(rng.integers(1, 4)), 0][0]
    return points.reshape(-1, 3), triangles


def one_face(rng):
    return rng.normal(size=(3, 3)), np.array([(0, 1, 2)])


def tangle(rng):
    """Triangles between any points: edges of many faces, faces twice, folded ones."""
    count = int(rng.integers(3, 20))
    triangles = rng.integers(0, count, (int(rng.integers(1, 60)), 3))
    return rng.uniform(-1.0, 1.0, (count, 3)) * (1.0, 1.0, rng.choice([0.0, 0.1, 1.0])), triangles


PARTS = (patch, moebius, fan, debris, slivers, one_face, tangle)
VALUES = (np.nan, np.inf, -np.inf, 1e30, 3e38, 1e-40, 1e7)


def made(rng):
    """A high object of some parts, spoiled."""
    soup = None
    for _ in range(int(rng.integers(1, 4))):
        points, triangles = PARTS[rng.integers(len(PARTS))](rng)
        more = spoiled.Soup(points * rng.choice([1.0, 1.0, 0.01]), triangles)
        soup = more if soup is None else spoiled.joined(soup, more)
    triangles = soup.triangles[(np.diff(np.sort(soup.triangles, axis=1), axis=1) > 0).all(axis=1)]
    if not len(triangles):
        triangles = np.array([(0, 1, 2)])  # Blender's meshes have no face with a vertex twice
    soup = spoiled.Soup(soup.points, triangles)
    soup = spoiled.flipped_at_random(soup, rng, rng.choice([0.0, 0.3, 1.0]))
    if rng.random() < 0.3:
        soup = spoiled.unwelded(soup, rng, 0.5)
    if rng.random() < 0.3:
        soup = spoiled.joined(soup, soup)
    if rng.random() < 0.3:
        count = int(rng.integers(1, 4))
        soup.points[rng.integers(0, len(soup.points), count), rng.integers(0, 3, count)] = rng.choice(VALUES, count)
    return spoiled.build("hi", soup, smooth=bool(rng.random() < 0.5))
