# SPDX-License-Identifier: GPL-3.0-or-later
"""Times of all bakers on pairs of meshes, in tangent space."""

from collections.abc import Callable, Iterator
from pathlib import Path

from scripts.bench import bakers, scenes
from scripts.bench.bakers import Imprint
from scripts.bench.comparing import CAST, FLATTEN, KEPT, OUTERMOST


def chosen(folder: Path | None, quick: bool) -> Iterator[tuple[Callable[[], scenes.Pair], tuple[int, ...]]]:
    """A function that opens each pair, and its map sizes: first the pairs of the paper's table, then terrains and others."""
    usual = (1024,) if quick else (512, 1024, 2048)
    for high, low in scenes.PAPER:
        yield scenes.sized(folder, high, low), usual
    known = set(scenes.PAPER)
    found = [path for path in sorted(folder.glob("*.blend")) if scenes.sizes(path)] if folder else []
    unknown = [path for path in found if scenes.sizes(path) not in known]
    terrains = [path for path in unknown if path.name.startswith(scenes.TERRAINS)]
    for path in terrains[:1] if quick else terrains:
        yield (lambda path=path: scenes.opened(path)), (2048,) if quick else usual
    if not terrains:
        yield (lambda: scenes.made(*scenes.TERRAIN)), (2048,) if quick else usual
    for path in () if quick else unknown:
        if path not in terrains:
            yield (lambda path=path: scenes.opened(path)), usual


def time_pair(pair: scenes.Pair, sizes: tuple[int, ...], repeats: int, quick: bool) -> list[dict]:
    """Time all contenders on a pair at all sizes, in tangent space, with one sample; `quick` leaves out the cached tree."""
    rows = []
    for size in sizes:
        ours = [
            Imprint(FLATTEN, pair, size, method="FLATTEN"),
            Imprint(CAST, pair, size, method="CAST"),
            Imprint(OUTERMOST, pair, size, method="CAST", hit="OUTERMOST"),
        ]
        if not quick:
            ours.append(Imprint(KEPT, pair, size, method="CAST", keep=True))
        field = [*ours, bakers.cycles(pair, size)]
        rows.append(row_of(pair, size, bakers.race(field, repeats)))
    return rows


def sampled(pair: scenes.Pair, sizes: tuple[int, ...]) -> list[int]:
    """The sizes at which several samples are timed: 1024, and 2048 for terrains."""
    return [size for size in sizes if size == 1024 or (size == 2048 and pair.is_terrain)]


def time_samples(pair: scenes.Pair, size: int, repeats: int, samples: int = 16) -> dict:
    """Time the contenders that support several samples per texel."""
    ours = [
        Imprint(FLATTEN, pair, size, method="FLATTEN", samples=samples),
        Imprint(CAST, pair, size, method="CAST", samples=samples),
    ]
    row = row_of(pair, size, bakers.race([*ours, bakers.cycles(pair, size, samples=samples)], repeats))
    return row | {"samples": samples}


def row_of(pair: scenes.Pair, size: int, timed: dict[str, bakers.Timed]) -> dict:
    high, low = pair.triangles
    return {
        "pair": pair.name,
        "is_terrain": pair.is_terrain,
        "high": high,
        "low": low,
        "size": size,
        "samples": 1,
        "times": {name: vars(times) for name, times in timed.items()},
    }
