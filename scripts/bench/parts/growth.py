# SPDX-License-Identifier: GPL-3.0-or-later
"""How cost grows with triangles, texels and samples."""

from collections.abc import Callable

from scripts.bench import scenes
from scripts.bench.bakers import Imprint
from scripts.bench.comparing import CAST, FLATTEN


def growth(quick: bool, repeats: int, log: Callable[[str], None]) -> dict[str, list[dict]]:
    """Measure how cost grows with triangles (at 512), with texels (one mesh, several sizes) and with samples (at 256)."""
    counts = (10_000, 31_623, 100_000, 316_228, 1_000_000) + (() if quick else (3_162_278, 10_000_000))
    sides = (256, 512, 1024, 2048) + (() if quick else (4096, 8192))
    samples = (1, 2, 4, 8, 16) + (() if quick else (64,))
    log("growth by triangles")
    scenes.empty()
    meshes = [scenes.sine(round((count / 2) ** 0.5), alone=False) for count in counts]
    triangles = _sweep([(pair, pair.triangles[0], 512, 1) for pair in meshes], repeats)
    log("growth by texels")
    pair = scenes.sine(316)
    texels = _sweep([(pair, side * side, side, 1) for side in sides], repeats)
    log("growth by samples")
    pair = scenes.sine(316)
    by_samples = _sweep([(pair, count, 256, count) for count in samples], repeats)
    return {"triangles": triangles, "texels": texels, "samples": by_samples}


def _sweep(cases: list[tuple[scenes.Pair, int, int, int]], repeats: int) -> list[dict]:
    """The points of one curve, from (pair, amount, size, samples). Each case bakes once per round, so that a temporary
    disturbance of the machine does not bend the curve."""
    points, bakers = [], []
    for pair, amount, size, samples in cases:
        points.append({"amount": amount, "seconds": {}})
        for name, method in ((FLATTEN, "FLATTEN"), (CAST, "CAST")):
            baker = Imprint(name, pair, size, method=method, samples=samples, image=f"{name} {amount}")
            baker.bake()
            bakers.append((baker, points[-1]["seconds"].setdefault(name, [])))
    for _ in range(repeats):
        for baker, seconds in bakers:
            seconds.append(baker.bake())
    return points
