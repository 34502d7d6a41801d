# SPDX-License-Identifier: GPL-3.0-or-later
"""Random pairs of low and high meshes with layers, all faces right: garments with linings over bodies, shells in shells, plates
with parts on them, open planes inside closed meshes, tubes in tubes, pages. All of a pair follows from its seed.

A layer is a soup; each layer of the low mesh has a band of the map for itself. `spoil` makes the high meshes wrong.
"""

from dataclasses import dataclass

import bpy
import numpy as np

from addon.mesh import topology
from tests.support import random_cases, spoiled
from tests.support.spoiled import Soup

GAP = 0.4
"""A texel shows another layer if its place is farther away than this share of the least distance between two of them."""


@dataclass(frozen=True)
class Pair:
    """What a bake takes, before it is built.

    low: one soup. highs: one for each layer. gap: the least distance between two layers. is_one_object: whether the high layers
    are one object.
    """

    kind: str
    low: Soup
    highs: list[Soup]
    gap: float
    is_one_object: bool

    def build(
        self, highs: list[Soup] | None = None, name: str = "hi"
    ) -> tuple[bpy.types.Object, list[bpy.types.Object]]:
        """The low object and the high ones."""
        layers = self.highs if highs is None else highs
        if self.is_one_object:
            layers = [all_of(layers)]
        low = bpy.data.objects.get("lo") or spoiled.build("lo", self.low)
        return low, [spoiled.build(f"{name} {number}", soup) for number, soup in enumerate(layers)]


def made(seed: int) -> Pair:
    """The pair of a seed."""
    rng = np.random.default_rng(seed)
    kind = list(FAMILIES)[seed % len(FAMILIES)]
    low, highs, gap = FAMILIES[kind](rng)
    turn, place = _rotation(rng), rng.normal(0.0, 1.0, 3)
    low, *highs = (
        Soup(soup.points @ turn.T + place, soup.triangles, soup.uv) for soup in (all_of(banded(low)), *highs)
    )
    return Pair(kind, low, highs, gap, bool(rng.random() < 0.6))


# Spoiled ones


def spoil(pair: Pair, rng: np.random.Generator) -> tuple[str, list[Soup]]:
    """What was done to the high layers of a pair, and the layers: what shows of them is the same."""
    how = random_cases.any_of(rng, list(SPOILERS))
    return how, SPOILERS[how](list(pair.highs), rng)


def _flip_faces(layers: list[Soup], rng: np.random.Generator) -> list[Soup]:
    share = rng.uniform(0.03, 0.3)
    way = spoiled.flipped_at_random if rng.random() < 0.5 else spoiled.flipped_in_regions
    return [way(layer, rng, share) if len(layer.triangles) > 16 else layer for layer in layers]


def _flip_a_layer(layers: list[Soup], rng: np.random.Generator) -> list[Soup]:
    number = int(rng.integers(len(layers)))
    layers[number] = spoiled.flipped(layers[number], np.ones(len(layers[number].triangles), bool))
    return layers


def _double(layers: list[Soup], rng: np.random.Generator) -> list[Soup]:
    """Some faces are there twice, turned to either side."""
    number = int(rng.integers(len(layers)))
    chosen = rng.random(len(layers[number].triangles)) < rng.uniform(0.1, 1.0)
    again = layers[number].at(chosen)
    if rng.random() < 0.5:
        again = spoiled.flipped(again, np.ones(len(again.triangles), bool))
    layers[number] = spoiled.joined(layers[number], again) if len(again.triangles) else layers[number]
    return layers


def _inverted_copy(layers: list[Soup], rng: np.random.Generator) -> list[Soup]:
    """A smaller copy of a closed layer inside it, inside out."""
    closed = [number for number, layer in enumerate(layers) if _is_solid(layer)]
    if not closed:
        return _flip_faces(layers, rng)
    number = random_cases.any_of(rng, closed)
    layer, factor = layers[number], rng.uniform(0.85, 0.95)
    middle = (layer.points.max(axis=0) + layer.points.min(axis=0)) / 2.0
    inner = Soup((layer.points - middle) * factor + middle, layer.triangles, layer.uv)
    layers[number] = spoiled.joined(layer, spoiled.flipped(inner, np.ones(len(inner.triangles), bool)))
    return layers


SPOILERS = {
    "faces turned over": _flip_faces,
    "a layer turned over": _flip_a_layer,
    "faces twice": _double,
    "an inverted copy inside": _inverted_copy,
}


# Hair


CELLS = np.zeros((8, 8), int)
"""The number of the part in each cell of a map, by rows: a quarter has the scalp, the others a card each."""
CELLS[4:], CELLS[:4, 4:] = np.arange(1, 33).reshape(4, 8), np.arange(33, 49).reshape(4, 4)


def hair(rng: np.random.Generator) -> tuple[list[Soup], list[Soup]]:
    """The parts of a low mesh and a high one: a scalp and 48 curved cards over it, which overlap, two thousandths of the
    diagonal apart. CELLS has their places in the map."""

    def over_scalp(down: np.ndarray, around: np.ndarray, far: np.ndarray) -> tuple:
        return far * np.sin(down) * np.cos(around), far * np.sin(down) * np.sin(around), far * np.cos(down)

    scalp = [_sheet(lambda u, v: over_scalp(0.05 + 1.45 * (1 - v), 2 * np.pi * u, 1.0 + 0.0 * u), n) for n in (16, 80)]
    lows, highs = [], []
    for count, top in ((4, 0.1), (10, 0.4), (16, 0.7), (18, 1.0)):
        for number in range(count):
            middle, turn = 2 * np.pi * (number + 0.5 * rng.random()) / count, 0.15 * rng.normal()
            lift, (wide, long) = 1.009 + 0.0055 * (number % 3 - 1), (0.34, 0.55) * rng.uniform(0.9, 1.15, 2)

            def card(u: np.ndarray, v: np.ndarray, waves: float, each=(middle, turn, lift, wide, long, top)) -> tuple:
                middle, turn, lift, wide, long, top = each
                down = top + 0.02 + long * (1 - v)
                around = middle + ((u - 0.5) * wide + turn * long * (1 - v)) / np.maximum(np.sin(down), 0.35)
                return over_scalp(down, around, lift + 0.014 * (1 - v) + waves * np.sin(8 * np.pi * u))

            lows.append(_sheet(lambda u, v, card=card: card(u, v, 0.0), 3))
            highs.append(_sheet(lambda u, v, card=card: card(u, v, 0.001), 20))
    cells = [np.argwhere(number == CELLS)[0][::-1] for number in range(1, 49)]
    return tuple(
        [Soup(whole.points, whole.triangles, (0.02 + 0.96 * whole.uv) / 2.0)]
        + [
            Soup(each.points, each.triangles, (0.05 + 0.9 * each.uv + cell) / 8.0)
            for each, cell in zip(cards, cells, strict=True)
        ]
        for whole, cards in zip(scalp, (lows, highs), strict=True)
    )


# Families: the layers of the low mesh, those of the high one, and the gap


def _garment(rng: np.random.Generator) -> tuple[list[Soup], list[Soup], float]:
    """A body, and a garment over it with an outer side and a lining, which faces the body."""
    radius, thick = 0.15, rng.uniform(3e-4, 1e-3)
    gap = 10.0 ** rng.uniform(np.log10(3e-4), np.log10(3e-3))
    segments, finer = int(rng.integers(8, 49)), int(rng.integers(24, 65))
    reach, is_capped = (0.03, 0.97), rng.random() < 0.4
    bumps = 0.3 * min(gap, thick)
    body = [
        _tube(radius, 0.0, segments, 4, is_capped=is_capped),
        _tube(radius, bumps, 120, 40, is_capped=is_capped),
    ]
    outer, lining = (
        [
            _tube(far, 0.0, finer, 4, reach, is_inward=is_inward),
            _tube(far, bumps * 0.5, 96, 30, reach, is_inward=is_inward),
        ]
        for far, is_inward in ((radius + gap + thick, False), (radius + gap, True))
    )
    chosen = random_cases.any_of(rng, [(0, 1, 2), (0, 1, 2), (1, 2), (0, 1), (1,)])
    layers = [body, outer, lining]
    return [layers[number][0] for number in chosen], [layer[1] for layer in layers], min(gap, thick)


def _shells(rng: np.random.Generator) -> tuple[list[Soup], list[Soup], float]:
    """Closed shells, one in the other; the last one can be the inner side of a hollow body."""
    count, radius, gap = int(rng.integers(2, 5)), 1.0, rng.uniform(0.01, 0.15)
    segments, bumps = int(rng.integers(12, 33)), 0.2 * gap * rng.random()
    low, high = [], []
    for number in range(count):
        is_inward = number == count - 1 and rng.random() < 0.3
        low.append(ball(radius, 0.0, segments, is_inward=is_inward))
        high.append(ball(radius, bumps, 64, is_inward=is_inward))
        radius -= gap * rng.uniform(1.0, 2.0)
    return low[: int(rng.integers(1, count + 1))], high, gap


def _plate(rng: np.random.Generator) -> tuple[list[Soup], list[Soup], float]:
    """A plate with rivets, cobbles, studs or cards on it, and a low mesh of two triangles or a few more."""
    divisions, kind = int(rng.integers(1, 9)), random_cases.any_of(rng, ["rivets", "cobbles", "studs", "cards"])
    low = [_sheet(lambda u, v: (2 * u - 1, 2 * v - 1, 0.0 * u), int(rng.integers(1, 5)))]
    if rng.random() < 0.5:
        plate = _sheet(lambda u, v: (2 * u - 1, 2 * v - 1, 0.0 * u), divisions)
    else:
        plate = box((0.0, 0.0, -0.05), (1.0, 1.0, 0.05))
    parts, step = [], 2.0 / divisions
    for i, j in np.ndindex(divisions, divisions):
        x, y = -1.0 + (i + 0.5 + 0.1 * rng.normal()) * step, -1.0 + (j + 0.5 + 0.1 * rng.normal()) * step
        size = step * rng.uniform(0.15, 0.35)
        flat = 0.04 * rng.uniform(0.3, 1.0)
        if kind in {"rivets", "cobbles"}:
            part = ball(1.0, 0.0, 12)
            deep = flat if kind == "rivets" else min(size, 0.12)
            part = Soup(part.points * (size, size, deep) + (x, y, 0.0), part.triangles, part.uv)
        elif kind == "studs":
            part = box((x, y, flat / 2), (size, size, flat))
        else:
            part = _sheet(lambda u, v, x=x, y=y, s=size: (x + s * (2 * u - 1), y + s * (2 * v - 1), 0.0 * u + 0.02), 2)
        parts.append(part)
    return low, [plate, all_of(parts)], 0.01


def _planes_inside(rng: np.random.Generator) -> tuple[list[Soup], list[Soup], float]:
    """Open planes of any direction inside a closed mesh."""
    if rng.random() < 0.5:
        low, high, most = ball(1.0, 0.0, int(rng.integers(8, 33))), ball(1.0, 0.01, 64), 0.6
    else:
        low, high, most = box((0, 0, 0), (1, 1, 1)), box((0, 0, 0), (1, 1, 1), 12), 0.55
    planes = []
    for _ in range(int(rng.integers(1, 5))):
        turn, place, size = _rotation(rng), rng.uniform(-0.2, 0.2, 3), rng.uniform(0.1, most - 0.3)
        flat = _sheet(lambda u, v, s=size: (s * (2 * u - 1), s * (2 * v - 1), 0.0 * u), 6)
        planes.append(Soup(flat.points @ turn.T + place, flat.triangles, flat.uv))
    return [low], [high, *planes], 0.05


def _boots(rng: np.random.Generator) -> tuple[list[Soup], list[Soup], float]:
    """A boot in a trouser leg, which ends halfway down the boot."""
    gap, segments = 10.0 ** rng.uniform(-3.0, -2.0), int(rng.integers(8, 33))
    end, is_capped = rng.uniform(0.2, 0.5), rng.random() < 0.5
    boot, leg = (
        [
            _tube(radius, bumps, n, nv, reach, is_capped=capped)
            for n, nv, bumps in ((segments, 4, 0.0), (96, 48, 0.2 * gap))
        ]
        for radius, reach, capped in ((0.1, (0.0, 0.6), is_capped), (0.1 + gap, (end, 1.0), False))
    )
    return [boot[0], leg[0]], [boot[1], leg[1]], gap


def _pistons(rng: np.random.Generator) -> tuple[list[Soup], list[Soup], float]:
    """A closed piston in a cylinder that has an outer and an inner wall."""
    gap, wall = rng.uniform(0.001, 0.01), rng.uniform(0.005, 0.03)
    segments, n = int(rng.integers(12, 41)), 96
    layers = [
        [_tube(0.1, bumps, s, 6, (0.1, 0.7), is_capped=True) for s, bumps in ((segments, 0.0), (n, 0.2 * gap))],
        [_tube(0.1 + gap, bumps, s, 6, is_inward=True) for s, bumps in ((segments, 0.0), (n, 0.2 * gap))],
        [_tube(0.1 + gap + wall, bumps, s, 6) for s, bumps in ((segments, 0.0), (n, 0.2 * gap))],
    ]
    chosen = random_cases.any_of(rng, [(0, 1, 2), (0, 1, 2), (0, 2), (1, 2)])
    return [layers[number][0] for number in chosen], [layer[1] for layer in layers], gap


def _pages(rng: np.random.Generator) -> tuple[list[Soup], list[Soup], float]:
    """Pages over each other, as sheets or as thin boxes; the low mesh has two triangles for each side."""
    gap, count, is_thick = rng.uniform(0.003, 0.03), int(rng.integers(2, 6)), rng.random() < 0.4
    low, high = [], []
    for number in range(count):
        z, shift = number * gap, 0.3 * number * rng.random(2)
        if is_thick:
            place = (*shift, z)
            low.append(box(place, (1.0, 1.0, 0.1 * gap)))
            high.append(box(place, (1.0, 1.0, 0.1 * gap), 8))
            continue

        def page(u: np.ndarray, v: np.ndarray, bumps: float, shift=shift, z=z) -> tuple:
            return 2 * u - 1 + shift[0], 2 * v - 1 + shift[1], z + bumps * np.sin(9 * u) * np.sin(7 * v)

        low.append(_sheet(lambda u, v, page=page: page(u, v, 0.0), 1))
        high.append(_sheet(lambda u, v, page=page: page(u, v, 0.2 * gap), 24))
    return low, high, 0.1 * gap if is_thick else gap


FAMILIES = {
    "garment": _garment,
    "shells": _shells,
    "plate": _plate,
    "planes inside": _planes_inside,
    "boots": _boots,
    "pistons": _pistons,
    "pages": _pages,
}


# Layers


def _tube(
    radius: float,
    bumps: float,
    nu: int,
    nv: int,
    reach: tuple[float, float] = (0.0, 1.0),
    *,
    is_inward: bool = False,
    is_capped: bool = False,
) -> Soup:
    """A tube along z, 0.5 long, with discs at its ends if it is capped."""
    u, v = np.meshgrid(np.arange(nu) / nu, np.linspace(0.0, 1.0, nv + 1))
    angle, height = 2.0 * np.pi * u, 0.5 * (reach[0] + v * (reach[1] - reach[0]))
    far = radius + bumps * np.sin(15 * angle) * np.sin(60 * height)
    points = np.stack([far * np.cos(angle), far * np.sin(angle), height], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(nu), np.arange(nv))
    a, b = i + j * nu, (i + 1) % nu + j * nu
    quads = np.stack([a, b, b + nu, a + nu], axis=-1).reshape(-1, 4)
    corners = np.stack([i, i + 1, i + 1, i], axis=-1) / nu, np.stack([j, j, j + 1, j + 1], axis=-1) / nv
    uv = np.stack(corners, axis=-1).reshape(-1, 4, 2)
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    uv = np.concatenate([uv[:, :3], uv[:, [0, 2, 3]]])
    if is_capped:
        rim = np.arange(nu)
        top, bottom, middles = rim + nv * nu, rim, len(points) + np.arange(2)
        points = np.concatenate([points, [[0, 0, height.max()], [0, 0, height.min()]]])
        discs = np.concatenate(
            [
                np.stack([top, np.roll(top, -1), np.full(nu, middles[0])], axis=1),
                np.stack([np.roll(bottom, -1), bottom, np.full(nu, middles[1])], axis=1),
            ]
        )
        flat = 0.5 + points[discs][..., :2] / (2.4 * radius)
        flat[..., 0] = (flat[..., 0] + np.repeat([0, 1], nu)[:, None]) / 2.0
        uv = np.concatenate([uv * (1.0, 0.6), flat * (1.0, 0.35) + (0.0, 0.63)])
        triangles = np.concatenate([triangles, discs])
    soup = Soup(points, triangles, uv)
    return spoiled.flipped(soup, np.ones(len(triangles), bool)) if is_inward else soup


def ball(radius: float, bumps: float, n: int, *, is_inward: bool = False) -> Soup:
    """A closed sphere of n x n / 2 quads."""
    nv = max(3, n // 2)
    u, v = np.meshgrid(np.arange(n) / n, np.arange(1, nv) / nv)
    lon, lat = 2.0 * np.pi * u, np.pi * (v - 0.5)
    away = np.stack([np.cos(lon) * np.cos(lat), np.sin(lon) * np.cos(lat), np.sin(lat)], axis=-1).reshape(-1, 3)
    away = np.concatenate([away, [[0, 0, -1], [0, 0, 1]]])
    points = away * (radius + bumps * np.sin(11.0 * away).prod(axis=1, keepdims=True))
    i, j = np.meshgrid(np.arange(n), np.arange(nv - 2))
    a, b = (i + j * n).ravel(), ((i + 1) % n + j * n).ravel()
    rim, after, last = np.arange(n), (np.arange(n) + 1) % n, n * (nv - 2)
    south, north = len(points) - 2, len(points) - 1
    triangles = np.concatenate(
        [
            np.stack([a, b, b + n], axis=1),
            np.stack([a, b + n, a + n], axis=1),
            np.stack([after, rim, np.full(n, south)], axis=1),
            np.stack([rim + last, after + last, np.full(n, north)], axis=1),
        ]
    )
    rows, column = (j.ravel() + 1.0) / nv, i.ravel() / n
    right, up, first, final = column + 1.0 / n, rows + 1.0 / nv, rim / n, (rim + 1.0) / n
    low_row, high_row = np.full(n, 1.0 / nv), np.full(n, (nv - 1.0) / nv)
    uv = np.concatenate(
        [
            _corners((column, rows), (right, rows), (right, up)),
            _corners((column, rows), (right, up), (column, up)),
            _corners((final, low_row), (first, low_row), ((first + final) / 2, 0.0 * first)),
            _corners((first, high_row), (final, high_row), ((first + final) / 2, 0.0 * first + 1.0)),
        ]
    )
    soup = Soup(points, triangles, uv)
    return spoiled.flipped(soup, np.ones(len(triangles), bool)) if is_inward else soup


def _corners(*corners: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1)


def _sheet(surface, n: int) -> Soup:
    """A grid of n x n quads over `surface`, a function from u and v (N,) to x, y and z."""
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1)))
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    a = (i + j * (n + 1)).ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + n + 2], axis=1), np.stack([a, a + n + 2, a + n + 1], axis=1)])
    return Soup(np.stack(np.broadcast_arrays(*surface(u, v)), axis=1), triangles, np.stack([u, v], axis=1)[triangles])


def box(middle: tuple, half: tuple, n: int = 1) -> Soup:
    """A closed box whose sides have n x n quads and one cell each of a 3 x 2 atlas."""
    parts = []
    for number in range(6):
        axis, sign = number // 2, 1.0 if number % 2 else -1.0

        def side(u: np.ndarray, v: np.ndarray, axis=axis, sign=sign) -> tuple:
            point = [0.0 * u + sign, 2 * u - 1, sign * (2 * v - 1)]
            return tuple(point[(number - axis) % 3] for number in range(3))

        one = _sheet(side, n)
        cell = (0.05 + 0.9 * one.uv + (number % 3, number // 3)) / (3.0, 2.0)
        parts.append(Soup(one.points * half + middle, one.triangles, cell))
    whole = all_of(parts)
    points, numbers = np.unique(np.round(whole.points, 9), axis=0, return_inverse=True)
    return Soup(points, numbers.reshape(-1)[whole.triangles], whole.uv)


def all_of(parts: list[Soup]) -> Soup:
    whole = parts[0]
    for part in parts[1:]:
        whole = spoiled.joined(whole, part)
    return whole


def banded(layers: list[Soup]) -> list[Soup]:
    """The layers, each in a band of the map of its own."""
    count = len(layers)
    return [
        Soup(layer.points, layer.triangles, (0.02 + 0.96 * layer.uv + (0.0, number)) / (1.0, count))
        for number, layer in enumerate(layers)
    ]


def _rotation(rng: np.random.Generator) -> np.ndarray:
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turn * np.sign(np.linalg.det(turn))


def _is_solid(soup: Soup) -> bool:
    """Whether a soup is one closed part that points outward."""
    ends = np.sort(np.concatenate([soup.triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    edges, counts = np.unique(ends, axis=0, return_counts=True)
    a, b, c = (soup.points - soup.points.mean(axis=0))[soup.triangles].transpose(1, 0, 2)
    is_one = len(np.unique(topology.connected(len(soup.points), *edges.T))) == 1
    return is_one and bool((counts == 2).all()) and float((a * np.cross(b, c)).sum()) > 0.0
