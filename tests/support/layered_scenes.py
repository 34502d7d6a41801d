"""Random scenes of surfaces that lie near each other, most of them broken in some way. Runs in any Blender."""

import bpy
import numpy as np

from addon.core.settings import Settings
from tests.support import zoo

SIZE = 48
GROUP = "painted"
CELLS = 3
"""Parts have their UVs in cells of a grid of this many on each side."""


def make(seed):
    """A low object, high objects and settings. All of it follows from the seed."""
    rng = np.random.default_rng(seed)
    surfaces = [_surface(rng, level) for level in range(rng.integers(1, 5))]
    low = _object(rng, "low", surfaces, coarse=True)
    lifted = [_lifted(rng, surface) for surface in surfaces]
    lifted += [_surface(rng, level) for level in range(rng.integers(0, 3))]
    parts = np.array_split(np.arange(len(lifted)), min(len(lifted), rng.choice([1, 1, 2, 3])))
    highs = [_object(rng, f"high {i}", [lifted[k] for k in part], coarse=False) for i, part in enumerate(parts)]
    if rng.random() < 0.2:
        matrix = np.eye(4)
        matrix[:3, :3] += rng.normal(0, 0.4, (3, 3))
        for obj in (low, *highs):
            obj.matrix_world = matrix.T.tolist()
    group = low.vertex_groups.new(name=GROUP)
    painted = np.flatnonzero(rng.random(len(low.data.vertices)) < 0.5).tolist()
    if painted:
        group.add(painted, float(rng.random()), "REPLACE")
    bpy.context.view_layer.update()
    return low, highs, _settings(rng)


def _settings(rng):
    def any_of(*values):
        return values[rng.integers(len(values))]

    return Settings(
        method=any_of("CAST", "CAST", "CAST", "AUTO"),
        space=any_of("TANGENT", "OBJECT", "WORLD"),
        width=SIZE,
        height=SIZE,
        samples=any_of(1, 1, 4),
        hit=any_of("OWN", "OWN", "OWN", "NEAREST", "OUTERMOST"),
        directions=any_of("BLENDED", "BLENDED", "SMOOTH", "SPLIT"),
        extrusion=any_of(None, None, None, 0.0, 0.1),
        max_distance=any_of(None, None, None, 0.3),
        facing_only=any_of(False, False, False, True),
        offset_group=any_of("", "", GROUP),
        straight_group=any_of("", "", GROUP),
        margin=any_of(0, 4),
        maps=any_of((), (), ("DISTANCE", "POSITION", "HEIGHT")),
        image="map",
        storage="MEMORY",
        depth=32,
        material=False,
    )


# Surfaces: functions from u and v (N,) to points (N, 3)


def _surface(rng, level):
    """A shell, a sheet or a finger; those of one scene lie closely one over the other."""
    gap = rng.choice([0.0, 1e-4, 0.02, 0.1])
    kind = rng.choice(["ball", "sheet", "finger"], p=[0.6, 0.25, 0.15])
    radius = 1.0 + gap * level
    shift = rng.normal(0, 0.05, 3) * (rng.random() < 0.3)

    def ball(u, v):
        longitude, latitude = 2 * np.pi * u, 1.4 * (2 * v - 1)
        flat = np.cos(latitude)
        return radius * np.stack([np.cos(longitude) * flat, np.sin(longitude) * flat, np.sin(latitude)], axis=1) + shift

    def sheet(u, v):
        return np.stack([2 * u - 1, 2 * v - 1, gap * level + 0.1 * np.sin(5 * u)], axis=1) + shift

    def finger(u, v):
        thick = 0.05 + gap
        across = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 20 * v], axis=1) * thick
        return across + (0.11 * level, 0.0, 0.0) + shift

    return {"ball": ball, "sheet": sheet, "finger": finger}[kind]


def _lifted(rng, surface):
    """The high surface of a low one: with waves, farther out or in, and sometimes turned inside out."""
    height, waves = rng.choice([0.0, 0.01, 0.05]), rng.integers(1, 6, 2)
    grown = 1.0 + rng.choice([0.0, 0.0, 0.02, -0.02])

    def lifted(u, v):
        points = surface(u, v)
        return points * (grown + height * np.sin(2 * np.pi * waves[0] * u) * np.sin(2 * np.pi * waves[1] * v))[:, None]

    return lifted


# Objects


def _object(rng, name, surfaces, *, coarse):
    """An object of all `surfaces`, of triangles, with noise and defects."""
    points, triangles, uv = np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros((0, 3, 2))
    for cell, surface in enumerate(surfaces):
        n = rng.integers(1, 7) if coarse else rng.integers(4, 20)
        grid, quads = zoo.grid_uv(n, n), zoo.grid_faces(n, n)
        halves = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        place = np.array((cell % CELLS, cell // CELLS % CELLS)) / CELLS
        uv = np.concatenate([uv, place + grid[halves] * 0.95 / CELLS])
        triangles = np.concatenate([triangles, halves + len(points)])
        points = np.concatenate([points, surface(*grid.T)])
    points = points + rng.normal(0, rng.choice([1e-5, 1e-4, 0.003, 0.03]), points.shape)
    for chance, defect in DEFECTS:
        if rng.random() < chance:
            points, triangles, uv = defect(rng, points, triangles, uv)
    return zoo.build(name, points, triangles, uv, smooth=bool(rng.random() < 0.6))


def _open(rng, points, triangles, uv):
    kept = rng.random(len(triangles)) < rng.choice([0.3, 0.9])
    kept[rng.integers(len(kept))] = True
    return points, triangles[kept], uv[kept]


def _single(rng, points, triangles, uv):
    one = rng.integers(len(triangles))
    return points, triangles[one : one + 1], uv[one : one + 1]


def _flipped(rng, points, triangles, uv):
    flipped = rng.random(len(triangles)) < rng.choice([0.1, 0.5, 1.0])
    triangles, uv = triangles.copy(), uv.copy()
    triangles[flipped], uv[flipped] = triangles[flipped, ::-1], uv[flipped, ::-1]
    return points, triangles, uv


def _fins(rng, points, triangles, uv):
    """Triangles on edges that have two already."""
    count = rng.integers(1, 9)
    bases = rng.integers(0, len(triangles), count)
    tips = points[triangles[bases, 2]] + rng.normal(0, 0.1, (count, 3))
    fins = np.stack([triangles[bases, 0], triangles[bases, 1], len(points) + np.arange(count)], axis=1)
    return np.concatenate([points, tips]), np.concatenate([triangles, fins]), np.concatenate([uv, uv[bases]])


def _doubled(rng, points, triangles, uv):
    """Some triangles twice, on vertices of their own."""
    twice = triangles[rng.random(len(triangles)) < 0.2]
    corners = len(points) + np.arange(twice.size).reshape(-1, 3)
    return (
        np.concatenate([points, points[twice].reshape(-1, 3)]),
        np.concatenate([triangles, corners]),
        np.concatenate([uv, uv[: len(twice)]]),
    )


def _degenerate(rng, points, triangles, uv):
    """Some triangles become a line or a point."""
    points = points.copy()
    some = triangles[rng.integers(0, len(triangles), rng.integers(1, 5))]
    points[some[:, 2]] = points[some[:, 1]] if rng.random() < 0.5 else 0.5 * (points[some[:, 0]] + points[some[:, 1]])
    return points, triangles, uv


def _crumpled_uv(rng, points, triangles, uv):
    """Some triangles have no area in UV space, or lie over others."""
    uv, some = uv.copy(), rng.random(len(triangles)) < 0.1
    uv[some] = uv[some][:, :1] if rng.random() < 0.5 else rng.random((np.count_nonzero(some), 3, 2))
    return points, triangles, uv


DEFECTS = (
    (0.3, _open),
    (0.3, _flipped),
    (0.25, _fins),
    (0.15, _doubled),
    (0.25, _degenerate),
    (0.2, _crumpled_uv),
    (0.08, _single),
)
