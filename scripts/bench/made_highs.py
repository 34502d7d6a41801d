# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes high meshes of kinds that no file at hand has, for comparisons of game assets. All of it follows from a seed.

.venv/bin/python scripts/bench/made_highs.py FOLDER [soup] [building] [character] [scan] [--scan 10000000]

Each is the object "hi" of FOLDER/NAME.blend: soup has a fifth of its faces turned over, and vertices that are not joined;
building has 300 parts that touch and cross; character is a skin with ears and fingers, and a collar that stands off; scan is a
lumpy ball of one piece with noise at several scales.
"""

import argparse
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.support import spoiled, zoo  # noqa: E402

SEED = 11


def lumpy(
    points: np.ndarray, rng: np.random.Generator, octaves: int, first: float = 2.0, height: float = 0.12
) -> np.ndarray:
    """How far points (V, 3) of about unit size are moved: waves in random directions, each octave half as long and high."""
    moved = np.zeros(len(points))
    for octave in range(octaves):
        for _ in range(6):
            way = rng.normal(size=3)
            wave = points @ (way / np.linalg.norm(way) * first * 2.0**octave) + rng.uniform(0.0, 2.0 * np.pi)
            moved += height / 2.0**octave / 3.0 * np.sin(wave)
    return moved


def ball(rings: int, rng: np.random.Generator, octaves: int) -> spoiled.Soup:
    """A lumpy unit sphere of about 4 * rings ** 2 triangles."""
    obj = zoo.ball("ball", rings)
    soup = spoiled.of_object(obj)
    bpy.data.objects.remove(obj)
    away = soup.points / np.linalg.norm(soup.points, axis=1, keepdims=True)
    return spoiled.Soup(away * (1.0 + lumpy(away, rng, octaves))[:, None], soup.triangles)


def soup(rng: np.random.Generator) -> bpy.types.Object:
    clean = ball(160, rng, 5)
    return spoiled.build("hi", spoiled.unwelded(spoiled.flipped_at_random(clean, rng, 0.2), rng, 0.1))


def scan(rng: np.random.Generator, triangles: int) -> bpy.types.Object:
    made = ball(round((triangles / 4.0) ** 0.5), rng, 9)
    noise = rng.normal(0.0, 0.1 * made.edge, len(made.points))
    return spoiled.build("hi", spoiled.Soup(made.points * (1.0 + noise)[:, None], made.triangles))


def box(low, high, cuts: int = 2) -> spoiled.Soup:
    """A closed box between two corners (3,) in quads of `cuts` a side, as triangles."""
    parts = []
    uv, quads = zoo.grid_uv(cuts, cuts), zoo.grid_faces(cuts, cuts)
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    for axis in range(3):
        for side in (0.0, 1.0):
            points = np.empty((len(uv), 3))
            points[:, axis], points[:, axis - 2], points[:, axis - 1] = side, uv[:, 0], uv[:, 1]
            parts.append(spoiled.Soup(points, triangles if side else triangles[:, ::-1]))
    whole = parts[0]
    for part in parts[1:]:
        whole = spoiled.joined(whole, part)
    return spoiled.Soup(np.array(low) + whole.points * (np.array(high) - np.array(low)), whole.triangles)


def column(place, radius: float, height: float, sides: int = 24) -> spoiled.Soup:
    """A closed fluted column at a place (3,)."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rim = radius * (1.0 + 0.06 * np.cos(12.0 * angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate(
        [np.c_[rim, np.zeros(sides)], np.c_[rim, np.full(sides, height)], [[0, 0, 0], [0, 0, height]]]
    )
    here, after = np.arange(sides), (np.arange(sides) + 1) % sides
    under, over = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    faces = [(here, after, after + sides), (here, after + sides, here + sides)]
    faces += [(under, after, here), (over, here + sides, after + sides)]
    return spoiled.Soup(points + place, np.concatenate([np.stack(each, axis=1) for each in faces]))


def building(rng: np.random.Generator) -> bpy.types.Object:
    """300 parts: a body, a plinth, a roof, 24 columns, and 91 windows of a frame, a sill and a pane."""
    parts = [
        box((0, 0, 0), (20, 10, 14), 8),
        box((-0.5, -0.5, -1), (20.5, 10.5, 0.2), 4),
        box((-0.4, -0.4, 14), (20.4, 10.4, 15), 4),
    ]
    parts += [column((0.6 + 0.82 * number, -0.3, 0.2), 0.18, 13.8) for number in range(24)]
    for number in range(91):
        column_, row, side = number % 13, number // 13 % 4, number // 52
        x, z, out = 0.9 + 1.45 * column_, 1.2 + 3.1 * row, 0.05 + 0.1 * rng.random()
        y = 10.0 if side else 0.0
        away = 1.0 if side else -1.0
        for (left, right, below, above), deep in (
            ((0.0, 1.0, 0.0, 2.0), out),
            ((-0.1, 1.1, -0.15, 0.0), 0.3),
            ((0.15, 0.85, 0.15, 1.85), out + 0.03),
        ):
            ends = sorted((y - 0.1 * away, y + deep * away))
            parts.append(box((x + left, ends[0], z + below), (x + right, ends[1], z + above)))
    whole = parts[0]
    for part in parts[1:]:
        whole = spoiled.joined(whole, part)
    return spoiled.build("hi", whole, smooth=False)


def ellipsoid(center, radii, way=(0.0, 0.0, 1.0)) -> spoiled.Soup:
    """A closed one, whose third axis lies along `way`."""
    obj = zoo.ball("ball", 24)
    made = spoiled.of_object(obj)
    bpy.data.objects.remove(obj)
    turned = np.array(Vector((0.0, 0.0, 1.0)).rotation_difference(Vector(way)).to_matrix())
    return spoiled.Soup((made.points * radii) @ turned.T + center, made.triangles)


def ring(center, radius: float, thick: float, height: float) -> spoiled.Soup:
    """A closed band around the z axis."""
    turns, sides = 96, 24
    i, j = np.meshgrid(np.arange(turns), np.arange(sides), indexing="ij")
    around, across = 2.0 * np.pi * i / turns, 2.0 * np.pi * j / sides
    far = radius + thick * np.cos(across) + 0.25 * height * np.sin(across)
    points = np.stack([far * np.cos(around), far * np.sin(around), height * np.sin(across)], axis=-1)
    here, after = i * sides + j, (i + 1) % turns * sides + j
    above, both = i * sides + (j + 1) % sides, (i + 1) % turns * sides + (j + 1) % sides
    halves = [np.stack([here, after, both], axis=-1), np.stack([here, both, above], axis=-1)]
    return spoiled.Soup(points.reshape(-1, 3) + center, np.concatenate([each.reshape(-1, 3) for each in halves]))


def character(rng: np.random.Generator) -> bpy.types.Object:
    parts = [
        ellipsoid((0, 0, 0), (0.55, 0.35, 0.8)),
        ellipsoid((0, 0, 0.95), (0.17, 0.17, 0.3)),
        ellipsoid((0, 0, 1.4), (0.34, 0.38, 0.42)),
    ]
    for side in (-1.0, 1.0):
        parts.append(ellipsoid((0.38 * side, 0.02, 1.42), (0.05, 0.12, 0.17), (0.3 * side, 0, 1)))  # an ear
        parts.append(ellipsoid((0.75 * side, 0, 0.35), (0.13, 0.13, 0.42), (side, 0, -0.6)))
        parts.append(ellipsoid((1.2 * side, 0, 0.05), (0.1, 0.1, 0.32), (side, 0, -0.5)))
        parts.append(ellipsoid((1.5 * side, 0, -0.1), (0.11, 0.05, 0.15), (side, 0, -0.4)))
        for number in range(5):  # fingers
            spread = 0.35 * (number - 2) / 2.0
            start = np.array((1.58 * side, 0.09 * (number - 2) / 2.0, -0.13))
            way = np.array((side, 1.2 * spread, -0.4))
            way /= np.linalg.norm(way)
            parts.append(ellipsoid(start + 0.1 * way, (0.024, 0.024, 0.13), way))
        parts.append(ellipsoid((0.25 * side, 0, -1.1), (0.2, 0.2, 0.6)))
        parts.append(ellipsoid((0.25 * side, -0.1, -1.68), (0.15, 0.3, 0.1)))
    whole = parts[0]
    for part in parts[1:]:
        whole = spoiled.joined(whole, part)
    obj = spoiled.build("body", whole)
    modifier = obj.modifiers.new("remesh", "REMESH")
    modifier.mode, modifier.voxel_size = "VOXEL", 0.012
    obj.modifiers.new("smooth", "SMOOTH").iterations = 3
    obj.modifiers.new("triangulate", "TRIANGULATE")
    data = bpy.data.meshes.new_from_object(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    bpy.data.objects.remove(obj)
    skin = bpy.data.objects.new("skin", data)
    body = spoiled.of_object(skin)
    bpy.data.objects.remove(skin)
    away = body.normals * lumpy(body.points, rng, 4, first=10.0, height=0.008)[:, None]
    body = spoiled.Soup(body.points + away, body.triangles)
    return spoiled.build("hi", spoiled.joined(body, ring((0, 0, 0.92), 0.26, 0.02, 0.12)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--scan", type=int, default=10_000_000, metavar="TRIANGLES")
    options = parser.parse_args()
    makers = {"soup": soup, "building": building, "character": character, "scan": lambda rng: scan(rng, options.scan)}
    for name in options.names or list(makers):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        high = makers[name](np.random.default_rng(SEED))
        high.matrix_world = Matrix()
        options.folder.mkdir(parents=True, exist_ok=True)
        bpy.ops.wm.save_as_mainfile(filepath=str((options.folder / f"{name}.blend").resolve()))
        print(f"{name}: {len(high.data.polygons):,} triangles", flush=True)


if __name__ == "__main__":
    main()
