#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes high meshes as people bring them, and says how far their maps are from those of the clean meshes.

    .venv/bin/python scripts/bench/spoiled_highs.py PAIRS_FOLDER [PART ...] [--size 512]

PAIRS_FOLDER has .blend files with the objects "hi" and "lo", which share a UV layout, king and helmet among them. Parts: flips
(faces turned over), soup (all flaws together), pushed (the low mesh off along its normals, beside Cycles at the best of some
distances), plates (a sheet or a slab over a part of a plane), cards (hair over a scalp), time (seconds on a clean mesh and on
soup).

"wrong" is the share of the covered texels whose normal is more than 30 degrees from the right one, or that are covered in one
map alone. Truth is the map of the clean mesh, and for cards that of Flatten. For pushed, wrong texels show a place of the high
mesh to which no short way over its surface leads from the right one; for plates, the plane where the plate is over it.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402
from mathutils.bvhtree import BVHTree  # noqa: E402

import addon  # noqa: E402
from addon.engine import tree_cache  # noqa: E402
from scripts.bench import scenes  # noqa: E402
from tests.support import cycles, maps, sheets, spoiled, zoo  # noqa: E402
from tests.support.spoiled import Soup  # noqa: E402

SEED = 7
NAMED = ("king", "helmet")
EXTRUSIONS = (0.5, 1.0, 1.5, 2.5, 4.0)
"""Of Cycles, in times of how far the low mesh is off, and at least 0.25 % of the diagonal."""
SAME = 1e-4
"""Share of the diagonal: closer places are the same."""
ROUNDS = 9


# Made pairs


def sheet(surface: Callable, nu: int, nv: int, rows: tuple[float, float] = (0.0, 1.0)) -> Soup:
    """A grid over `surface`, a function from u and v (N,) to points (N, 3), whose UVs fill rows of the map."""
    uv, quads = zoo.grid_uv(nu, nv), zoo.grid_faces(nu, nv)
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    placed = np.stack([uv[:, 0], rows[0] + uv[:, 1] * (rows[1] - rows[0])], axis=1)
    return Soup(surface(*uv.T), triangles, placed[triangles])


def joined(parts: list[Soup]) -> Soup:
    whole = parts[0]
    for part in parts[1:]:
        whole = spoiled.joined(whole, part)
    return whole


def _ball(radius: float, bumps: float, lumps: float = 0.0) -> Callable:
    def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        lon, lat = 2.0 * np.pi * u, np.radians(170.0) * (v - 0.5)
        away = np.stack([np.cos(lon) * np.cos(lat), np.sin(lon) * np.cos(lat), np.sin(lat)], axis=1)
        far = 1.0 + lumps * np.sin(3.0 * away + 0.5).sum(axis=1) + bumps * np.sin(31.0 * away).prod(axis=1)
        return radius * far[:, None] * away

    return surface


def _ring(number: int, bumps: float) -> Callable:
    """A link of a chain: each second one is turned by a quarter."""

    def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        u, v = 2.0 * np.pi * u, 2.0 * np.pi * v
        thick = 0.18 * (1.0 + bumps * np.sin(12.0 * u) * np.sin(4.0 * v))
        x, y, z = (1.0 + thick * np.cos(v)) * np.cos(u), (1.0 + thick * np.cos(v)) * np.sin(u), thick * np.sin(v)
        return np.stack([x + 1.4 * number, *((y, z) if number % 2 else (z, -y))], axis=1)

    return surface


def made(name: str) -> tuple[Soup, Soup]:
    """The low and the high soup of a made pair."""
    if name == "eye":  # three shells, one in the other
        shells = [(1.0, (0.0, 0.33)), (0.93, (0.34, 0.66)), (0.6, (0.67, 1.0))]
        return tuple(
            joined([sheet(_ball(radius, bumps), n, n // 2, rows) for radius, rows in shells])
            for bumps, n in ((0.0, 48), (0.01, 256))
        )
    if name == "phobos":
        return sheet(_ball(1.0, 0.0, 0.08), 48, 24), sheet(_ball(1.0, 0.03, 0.08), 400, 200)
    return tuple(
        joined([sheet(_ring(k, bumps), n, n // 3, (k / 5.0, (k + 0.95) / 5.0)) for k in range(5)])
        for bumps, n in ((0.0, 48), (0.06, 192))
    )


def opened(name: str, folder: Path) -> tuple[bpy.types.Object, Soup]:
    """The low object of a pair, and the soup of the high one."""
    if name in ("eye", "phobos", "chain"):
        scenes.empty()
        low, high = made(name)
        return spoiled.build("lo", low), high
    pair = scenes.opened(next(iter(sorted(folder.glob(f"{name}*.blend")))))
    soup = spoiled.of_object(pair.high)
    bpy.data.objects.remove(pair.high)
    return pair.low, soup


# Parts


def cast(low: bpy.types.Object, high: bpy.types.Object, size: int, **settings) -> np.ndarray:
    return maps.bake(low, high, **{"method": "CAST", "space": "WORLD", "size": (size, size)} | settings)


def flips(folder: Path, size: int) -> Iterator[str]:
    yield "| pair | 5, 15, 30 % in patches | 5, 15, 30 % at random | 30 % in patches, as they are |"
    for file in sorted(folder.glob("*.blend")):
        low, soup = opened(file.stem, folder)
        clean = cast(low, spoiled.build("clean", soup), size)
        cells = []
        for spoil in (spoiled.flipped_in_regions, spoiled.flipped_at_random):
            found = []
            for share in (0.05, 0.15, 0.3):
                dirty = spoiled.build("dirty", spoil(soup, np.random.default_rng(SEED), share))
                found.append(percent(spoiled.wrong(clean, cast(low, dirty, size))))
            cells.append(", ".join(found))
        dirty = spoiled.build("kept", spoiled.flipped_in_regions(soup, np.random.default_rng(SEED), 0.3))
        cells.append(percent(spoiled.wrong(clean, cast(low, dirty, size, keep_faces=True))))
        yield f"| {file.stem} | {' | '.join(cells)} |"


def soup(folder: Path, size: int) -> Iterator[str]:
    yield "| pair | wrong | as it is | AO, thickness, base color: mean of 255 | as it is |"
    wanted = {"maps": ("AO", "THICKNESS", "BASE_COLOR"), "size": size, "method": "CAST", "samples": 1}
    names = [*NAMED, "eye", "phobos", "chain", *sorted(file.stem for file in folder.glob("*.blend"))]
    for name in [name for number, name in enumerate(names) if not name.startswith(tuple(names[:number]))]:
        low, high = opened(name, folder)
        clean = spoiled.build("clean", high, like=high)
        dirty = spoiled.build("dirty", spoiled.all_together(high, np.random.default_rng(SEED)), like=high)
        truth, truths = cast(low, clean, size), maps.bake_all_maps(low, clean, **wanted)[1]
        cells = []
        for kept in (False, True):
            _, found = maps.bake_all_maps(low, dirty, keep_faces=kept, **wanted)
            far = [255.0 * np.abs(truths[each] - found[each])[..., :3].mean() for each in truths]
            wrong = percent(spoiled.wrong(truth, cast(low, dirty, size, keep_faces=kept)))
            cells.append((wrong, ", ".join(f"{value:.2f}" for value in far)))
        yield f"| {name} | {cells[0][0]} | {cells[1][0]} | {cells[0][1]} | {cells[1][1]} |"


def pushed(folder: Path, size: int) -> Iterator[str]:
    yield "| pair | off by % | wrong place | unsure % | Cycles, best | warnings |"
    for name in (*NAMED, "chain", "phobos"):
        low, soup = opened(name, folder)
        high = spoiled.build("high", soup)
        judge = Judge(soup, places(low, high, size, method="FLATTEN")[1])
        diagonal = spoiled.of_object(low).diagonal
        unmoved = np.array([vertex.co[:] for vertex in low.data.vertices])
        normals = np.array([vertex.normal[:] for vertex in low.data.vertices])
        scale = np.cbrt(abs(low.matrix_world.determinant()))
        for share in (0.0, -0.02, -0.01, -0.005, 0.005, 0.01, 0.02):
            moved = unmoved + normals * share * diagonal / scale
            low.data.vertices.foreach_set("co", moved.astype(np.float32).ravel())
            low.data.update()
            report, found = places(low, high, size)
            best = min(
                (judge.wrong(cycles_places(low, high, size, reach * diagonal)), reach)
                for reach in [factor * max(abs(share), 0.0025) for factor in EXTRUSIONS]
            )
            unsure, wrong = percent(report.checks["unsure"]["share"]), percent(judge.wrong(found))
            told = "; ".join(warning.split(":")[0][:60] for warning in report.warnings)
            yield f"| {name} | {100 * share:+.1f} | {wrong} | {unsure} | {percent(best[0])} at {best[1]:.2%} | {told} |"


def places(low: bpy.types.Object, high: bpy.types.Object, size: int, **settings):
    """The report of a bake, and the places (H, W, 4) of the hits in the world."""
    report, found = maps.bake_all_maps(
        low, high, maps=["POSITION"], size=size, **{"method": "CAST", "space": "WORLD"} | settings
    )
    return report, found["position"]


def cycles_places(low: bpy.types.Object, high: bpy.types.Object, size: int, extrusion: float) -> np.ndarray:
    texels, mask = cycles.bake(low, (size, size), "POSITION", highs=[high], extrusion=extrusion)
    return np.concatenate([texels[..., :3], mask[..., None]], axis=2)


class Judge:
    """Finds texels that show another place of a surface than they should. truth (H, W, 4): the places."""

    def __init__(self, soup: Soup, truth: np.ndarray):
        self._corners = soup.points[soup.triangles]
        self._across, self._same = sheets.across(soup.points, soup.triangles), SAME * soup.diagonal
        self._tree = BVHTree.FromPolygons(soup.points.tolist(), soup.triangles.tolist())
        self._truth = truth

    def wrong(self, found: np.ndarray) -> float:
        """The share of the texels that show a place to which no short way leads, or none."""
        is_meant = self._truth[..., 3] > 0
        truth, texels = self._truth[is_meant].astype(float), found[is_meant].astype(float)
        differs = np.flatnonzero(np.linalg.norm(truth[:, :3] - texels[:, :3], axis=1) > self._same)
        differs = differs[texels[differs, 3] > 0]
        ends = []
        for points in (truth[differs, :3], texels[differs, :3]):
            ends.append((points, np.array([self._tree.find_nearest(point)[2] for point in points.tolist()], int)))
        is_wrong = ~sheets.are_connected(self._corners, self._across, *ends)
        return (np.count_nonzero(is_wrong) + np.count_nonzero(texels[:, 3] <= 0)) / len(truth)


def baked(low: bpy.types.Object, high: bpy.types.Object, size: int, **settings):
    """The report and the map of a bake by Cast."""
    report, _ = maps.bake_all_maps(low, high, maps=(), size=size, method="CAST", **settings)
    return report, maps.pixels(bpy.data.images["map"])


def plates(_folder: Path, size: int) -> Iterator[str]:
    yield "| plate | cover % | height % | wrong | unsure % | by Outermost | warnings |"
    diagonal = np.sqrt(8.0)
    for kind in ("sheet", "slab"):
        for cover in (0.1, 0.2, 0.35, 0.6):
            for share in (0.017, 0.05, 0.115, 0.17):
                scenes.empty()
                low, height, half = zoo.plane("lo", 4), share * diagonal, np.sqrt(cover)
                high = spoiled.build("hi", plate(kind, half, height))
                cells = []
                for hit in ("OWN", "OUTERMOST"):
                    report, found = maps.bake_all_maps(low, high, maps=["POSITION"], size=size, method="CAST", hit=hit)
                    side = np.abs(2.0 * maps.texel_uv(size, size) - 1.0).max(axis=2)
                    is_far = np.abs(found["position"][..., 2] - np.where(side < half, height, 0.0)) > 0.3 * height
                    is_judged = np.abs(side - half) > 4.0 / size
                    cells.append((is_far[is_judged].mean(), report))
                report = cells[0][1]
                told = "; ".join(warning.split(":")[0][:90] for warning in report.warnings)
                yield (
                    f"| {kind} | {100 * cover:.0f} | {100 * share:.1f} | {percent(cells[0][0])} | "
                    f"{percent(report.checks['unsure']['share'])} | {percent(cells[1][0])} | {told} |"
                )


def plate(kind: str, half: float, height: float) -> Soup:
    """A plane with waves, and a sheet over its middle; a slab is closed, and a tenth as thick as it is high."""

    def ground(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.stack([2 * u - 1, 2 * v - 1, 0.002 * np.sin(20 * u) * np.sin(20 * v)], axis=1)

    def top(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        z = height + 0.002 * np.sin(30 * u) * np.sin(30 * v)
        return np.stack([half * (2 * u - 1), half * (2 * v - 1), z], axis=1)

    over = sheet(top, 40, 40)
    if kind == "slab":
        below = Soup(over.points - (0.0, 0.0, 0.1 * height), over.triangles[:, ::-1], over.uv[:, ::-1])
        over = spoiled.joined(over, below)
        rim = np.concatenate([np.arange(40), 40 + 41 * np.arange(40), 1680 - np.arange(40), 1640 - 41 * np.arange(40)])
        after, under = np.roll(rim, -1), rim + 1681
        sides = np.concatenate(
            [np.stack([rim, under, after], axis=1), np.stack([after, under, np.roll(under, -1)], axis=1)]
        )
        uv = np.concatenate([over.uv, np.zeros((len(sides), 3, 2))])
        over = Soup(over.points, np.concatenate([over.triangles, sides]), uv)
    return spoiled.joined(sheet(ground, 80, 80), over)


def cards(_folder: Path, size: int) -> Iterator[str]:
    yield "| high cards | wrong on cards | on the scalp | unsure % | warnings |"
    for is_flipped in (False, True):
        scenes.empty()
        low, high = hair(0.0, 1, 3), hair(0.02, 12, 40)
        if is_flipped:  # cards have two sides: how a file has them turned is chance
            chosen = np.zeros(len(high.triangles), bool)
            cell = (len(high.triangles) - 2 * 48 * 48) // 49
            for number in np.flatnonzero(np.random.default_rng(SEED).random(49) < 0.5):
                chosen[2 * 48 * 48 + number * cell :][:cell] = True
            high = spoiled.flipped(high, chosen)
        low, high = spoiled.build("lo", low), spoiled.build("hi", high)
        truth = spoiled.build("truth", hair(0.02, 12, 40))
        expected = cast(low, truth, size, method="FLATTEN")
        bpy.data.objects.remove(truth)
        report, found = baked(low, high, size, space="WORLD")
        half = size // 2
        on_cards, on_scalp = (spoiled.wrong(expected[rows], found[rows]) for rows in (np.s_[half:], np.s_[:half]))
        told = "; ".join(warning.split(":")[0][:90] for warning in report.warnings)
        unsure = percent(report.checks["unsure"]["share"])
        kind = "turned by chance" if is_flipped else "as the low ones"
        yield f"| {kind} | {percent(on_cards)} | {percent(on_scalp)} | {unsure} | {told} |"


def hair(bumps: float, across: int, along: int) -> Soup:
    """A scalp in the lower half of the map, and 49 cards over it, each over the roots of the next ones."""

    def scalp(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        x, y = 2 * u - 1, 2 * v - 1
        return np.stack([x, y, -0.3 * (x * x + y * y) + bumps * 0.2 * np.sin(20 * u) * np.sin(20 * v)], axis=1)

    parts = [sheet(scalp, 48 if bumps else 8, 48 if bumps else 8, (0.0, 0.49))]
    rng = np.random.default_rng(SEED)
    for number in range(49):
        column, row = number % 7, number // 7
        x, y, turn = (column + 0.5) / 3.5 - 1.0, row / 3.5 - 1.0, rng.normal(0.0, 0.2)

        def card(u: np.ndarray, v: np.ndarray, x=x, y=y, turn=turn) -> np.ndarray:
            side, far = 0.3 * (u - 0.5), 0.55 * v
            px, py = x + side * np.cos(turn) - far * np.sin(turn), y + side * np.sin(turn) + far * np.cos(turn)
            lift = 0.01 + 0.09 * np.sin(np.pi * 0.5 * v) + bumps * 0.5 * np.sin(6 * np.pi * u)
            return np.stack([px, py, -0.3 * (px * px + py * py) + lift], axis=1)

        one = sheet(card, across, along)
        uv = one.uv * (0.95 / 7, 0.45 / 7) + (column / 7, 0.51 + 0.49 * row / 7)
        parts.append(Soup(one.points, one.triangles, uv))
    return joined(parts)


def times(folder: Path, size: int) -> Iterator[str]:
    yield f"| mesh | triangles | method | seconds | as it is | more (median of {ROUNDS} rounds, first and last quartile) |"
    for name in (*NAMED, "kepler", "spot_control"):
        low, soup = opened(name, folder)
        if name == "king":
            soup = finer(soup)
        spoilt = spoiled.all_together(soup, np.random.default_rng(SEED))
        for kind, one in (("clean", soup), ("soup", spoilt)):
            high = spoiled.build(kind, one)
            for method in ("CAST", "AUTO") if kind == "clean" else ("CAST",):
                taken: dict[bool, list[float]] = {False: [], True: []}
                for number in range(ROUNDS + 1):
                    for kept in (False, True) if number % 2 else (True, False):
                        tree_cache.trees.free()
                        begin = time.perf_counter()
                        cast(low, high, size, keep_faces=kept, method=method)
                        taken[kept].append(time.perf_counter() - begin)
                own, kept = (statistics.median(taken[which][1:]) for which in (False, True))
                ratios = np.array(taken[False][1:]) / taken[True][1:] - 1.0
                spread = ", ".join(f"{value:+.1%}" for value in np.quantile(ratios, (0.25, 0.75)))
                yield (
                    f"| {name}, {kind} | {len(one.triangles):,} | {method} | {own:.2f} | {kept:.2f} | "
                    f"{own - kept:+.2f} s, {np.median(ratios):+.1%} ({spread}) |"
                )


def finer(soup: Soup) -> Soup:
    """Each triangle as four."""
    ends = np.sort(np.concatenate([soup.triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    edges, which = np.unique(ends, axis=0, return_inverse=True)
    middle = len(soup.points) + which.reshape(3, -1).T
    a, b, c = soup.triangles.T
    ab, bc, ca = middle.T
    uv = soup.uv
    between = (uv + np.roll(uv, -1, axis=1)) / 2.0
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    sides = [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]
    every = np.concatenate([uv, between], axis=1)
    return Soup(
        np.concatenate([soup.points, soup.points[edges].mean(axis=1)]),
        np.concatenate([np.stack(corner, axis=1) for corner in corners]),
        np.concatenate([every[:, side] for side in sides]),
    )


def percent(share: float) -> str:
    return f"{100.0 * share:.3g}"


PARTS = {"flips": flips, "soup": soup, "pushed": pushed, "plates": plates, "cards": cards, "time": times}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path)
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], default=[])
    parser.add_argument("--size", type=int, default=512)
    given = parser.parse_args()
    gpu.init()
    addon.register()
    for name in given.parts or PARTS:
        print(f"\n{name}, {given.size} x {given.size}\n")
        for row in PARTS[name](given.pairs.resolve(), given.size):
            print(row, flush=True)
    addon.unregister()
    return 0


if __name__ == "__main__":
    sys.exit(main())
