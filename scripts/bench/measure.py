# SPDX-License-Identifier: GPL-3.0-or-later
"""The measurements. They return plain data for report.py."""

import json
import os
import platform
import re
import statistics
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import gpu
import numpy as np

from addon.passes.program import in_software
from scripts.bench import contenders, peers, scenes
from scripts.bench.contenders import CAST, FLATTEN, KEPT, OUTERMOST, Imprint, Timed
from scripts.bench.peers import Peers
from scripts.dev import export

PAPER = (
    # high and low polygons; milliseconds on the paper's GPU, of ATI NormalMapper and of nVidia Melody
    (1696, 536, "under 1", 16850, 16306),
    (7910, 4274, "under 1", 24125, 50589),
    (48048, 23378, "31", 97704, 160975),
    (61644, 20517, "31", 129969, 179569),
)
"""Table 1 of the paper: Gumbau, González and Chover, "Hardware generation of normal maps"."""
TERRAIN = (275_772, 9_079)
"""The demo's terrain, used if no folder of pairs has one."""
COPIED = 256 * 2**20


def machine() -> dict:
    """The machine of the measurements."""
    gpu.init()
    renderer = gpu.platform.renderer_get()
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "renderer": renderer,
        "in_software": in_software(renderer),
        "backend": gpu.platform.backend_type_get(),
        "blender": bpy.app.version_string,
        "copy_gigabytes_per_second": copy_bandwidth() / 1e9,
    }


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    found = re.search(r"model name\s*: (.+)", text)
    return found[1] if found else platform.processor()


def copy_bandwidth() -> float:
    """The bytes per second that numpy reads and writes when it copies, the best of several runs."""
    source = np.ones(COPIED // 4, np.float32)
    target = np.zeros_like(source)
    return 2.0 * COPIED / min(contenders.clocked(lambda: np.copyto(target, source)) for _ in range(5))


# Pairs


def pairs(folder: Path | None, quick: bool) -> Iterator[tuple[Callable[[], scenes.Pair], tuple[int, ...]]]:
    """A function that opens each pair, and its map sizes: first the pairs of the paper's table, then terrains and others."""
    usual = (1024,) if quick else (512, 1024, 2048)
    for high, low, *_ in PAPER:
        yield scenes.sized(folder, high, low), usual
    known = {(high, low) for high, low, *_ in PAPER}
    found = [path for path in sorted(folder.glob("*.blend")) if scenes.sizes(path)] if folder else []
    unknown = [path for path in found if scenes.sizes(path) not in known]
    terrains = [path for path in unknown if path.name.startswith(scenes.TERRAINS)]
    for path in terrains[:1] if quick else terrains:
        yield (lambda path=path: scenes.opened(path)), (2048,) if quick else usual
    if not terrains:
        yield (lambda: scenes.made(*TERRAIN)), (2048,) if quick else usual
    for path in () if quick else unknown:
        if path not in terrains:
            yield (lambda path=path: scenes.opened(path)), usual


def time_pair(pair: scenes.Pair, sizes: tuple[int, ...], repeats: int, others: Peers, quick: bool) -> list[dict]:
    """Time all contenders on a pair at all sizes, in tangent space, with one sample; `quick` leaves out the cached tree."""
    others.load(pair) if others.bakers else None
    rows = []
    for size in sizes:
        ours = [
            Imprint(FLATTEN, pair, size, method="FLATTEN"),
            Imprint(CAST, pair, size, method="CAST"),
            Imprint(OUTERMOST, pair, size, method="CAST", hit="OUTERMOST"),
        ]
        if not quick:
            ours.append(Imprint(KEPT, pair, size, method="CAST", keep=True))
        field = [*ours, contenders.cycles(pair, size), *contenders.outside_blender(others, size)]
        rows.append(_row(pair, size, contenders.race(field, repeats)))
    return rows


def time_samples(pair: scenes.Pair, size: int, repeats: int, samples: int = 16) -> dict:
    """Time the contenders that support several samples per texel."""
    ours = [
        Imprint(FLATTEN, pair, size, method="FLATTEN", samples=samples),
        Imprint(CAST, pair, size, method="CAST", samples=samples),
    ]
    row = _row(pair, size, contenders.race([*ours, contenders.cycles(pair, size, samples=samples)], repeats))
    return row | {"samples": samples}


def _row(pair: scenes.Pair, size: int, timed: dict[str, Timed]) -> dict:
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


# Accuracy


def closed_forms(quick: bool, repeats: int, others: Peers) -> list[dict]:
    """Measure times, and degrees from the truth, on surfaces with known normals, in world space, on the same texels."""
    size, n = (512, 256) if quick else (1024, 512)
    rows = []
    for build in (scenes.sine, scenes.belt):
        pair = build(n)
        others.load(pair) if others.bakers else None
        field = [
            Imprint(FLATTEN, pair, size, method="FLATTEN", space="WORLD"),
            Imprint(CAST, pair, size, method="CAST", space="WORLD"),
            contenders.cycles(pair, size, space="OBJECT"),
            *contenders.outside_blender(others, size),
        ]
        rows.append(_with_angles(pair, size, field, repeats))
    pair, sculpt = scenes.multires(9)
    field = [Imprint(FLATTEN, pair, size, method="FLATTEN", space="WORLD"), contenders.multires(sculpt, size)]
    return [*rows, _with_angles(pair, size, field, repeats)]


def _with_angles(pair: scenes.Pair, size: int, field: list[contenders.Contender], repeats: int) -> dict:
    timed = contenders.race(field, repeats)
    angles = {}
    for contender in field:
        if timed[contender.name].gap:
            continue
        try:
            angles[contender.name] = contenders.deviation(pair, contender.normals())
        except peers.PeerError as error:
            timed[contender.name].gap = str(error)
    return _row(pair, size, timed) | {"angles": angles}


# Growth


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
        points.append({"amount": amount, "seconds": {}, "peak_gigabytes": {}})
        for name, method in ((FLATTEN, "FLATTEN"), (CAST, "CAST")):
            baker = Imprint(name, pair, size, method=method, samples=samples, image=f"{name} {amount}")
            forget_peak()
            baker.bake()
            points[-1]["peak_gigabytes"][name] = peak_gigabytes()
            bakers.append((baker, points[-1]["seconds"].setdefault(name, [])))
    for _ in range(repeats):
        for baker, seconds in bakers:
            seconds.append(baker.bake())
    return points


def forget_peak() -> None:
    """Reset the peak memory of this process, if the system supports it."""
    clear = Path("/proc/self/clear_refs")
    if clear.exists():
        clear.write_text("5", encoding="ascii")


def peak_gigabytes() -> float | None:
    """The peak memory of this process since `forget_peak`, or None if the system does not report it."""
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text(encoding="ascii")) if status.exists() else None
    return int(found[1]) * 1024 / 1e9 if found else None


def exponents(points: list[dict], name: str, last: int | None = None) -> dict[str, float]:
    """The b of seconds = a * amount ** b, by least squares of the logarithms: of the medians, and its range over rounds.

    last: use only this many of the largest points, where the constant cost of a bake hides the growth least.
    """
    points = points[-last:] if last else points
    amounts = np.log([point["amount"] for point in points])
    rounds = np.array([point["seconds"][name] for point in points])

    def fitted(seconds: np.ndarray) -> float:
        return float(np.polyfit(amounts, np.log(seconds), 1)[0])

    each = [fitted(column) for column in rounds.T]
    return {"median": fitted(np.median(rounds, axis=1)), "least": min(each), "most": max(each)}


# The limit


def terrain(folder: Path | None) -> scenes.Pair:
    """The first terrain of the folder, or the demo's."""
    found = [path for path in sorted(folder.glob("*.blend")) if path.name.startswith(scenes.TERRAINS)] if folder else []
    return scenes.opened(found[0]) if found else scenes.made(*TERRAIN)


def limit(row: dict, gigabytes_per_second: float) -> dict:
    """Compare the stages of Flatten and Cast in a row of `time_pair` with the time to copy the bytes that each must move.

    A texel has 16 bytes, a corner 32 (position, normal, UV). Each byte is read once and written once.
    """
    corners, texels = 2 * 3 * 32, 2 * 16 * row["size"] ** 2
    least = {
        "extract": (row["high"] + row["low"]) * corners,
        "tree": row["high"] * corners,
        "upload": row["high"] * corners,
        "draw": texels,
        "read": texels,
        "audit": texels,
        "image": texels,
    }
    methods = {}
    for name in (FLATTEN, CAST):
        stages = dict(row["times"][name]["stages"])
        if not stages:
            continue
        total = stages.pop("total")
        methods[name] = {
            "total": total,
            "stages": {
                stage: {
                    "seconds": seconds,
                    "bytes": least.get(stage, 0),
                    "least_seconds": least.get(stage, 0) / gigabytes_per_second / 1e9,
                }
                for stage, seconds in stages.items()
                if seconds
            },
        }
    return {
        "pair": row["pair"],
        "size": row["size"],
        "gigabytes_per_second": gigabytes_per_second,
        "methods": methods,
    }


# The shaders alone


def hardware(folder: Path | None, scratch: Path, quick: bool) -> dict:
    """Run scripts/dev/hardware.py, which times the shaders without Blender. Returns its result, or {"error": the reason}."""
    files = []
    sizes = (1024, 2048) if quick else (512, 1024, 2048)
    counts = [(high, low) for high, low, *_ in PAPER] + [TERRAIN]
    for high, low in counts[3:] if quick else counts:
        pair = terrain(folder) if (high, low) == TERRAIN else scenes.sized(folder, high, low)()
        blend, file = scratch / f"{pair.name}.blend", scratch / f"{pair.name}.npz"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
        export.export(blend, file)
        files.append(file)
    result = scratch / "hardware.json"
    command = [str(peers.PYTHON), str(peers.ROOT / "scripts/dev/hardware.py"), *map(str, files)]
    command += ["--sizes", *map(str, sizes), "--output", str(result)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        return {"error": (done.stderr.strip().splitlines() or ["no message"])[-1]}
    return json.loads(result.read_text(encoding="utf-8"))


def ratios(row: dict, slower: str, faster: str) -> dict[str, float] | None:
    """The speedup: the ratio of the medians, and the minimum and maximum of the rounds. None for a gap."""
    theirs, ours = (row["times"].get(name, {}).get("seconds") for name in (slower, faster))
    if not theirs or not ours:
        return None
    each = [a / b for a, b in zip(theirs, ours, strict=True)]
    return {"median": statistics.median(theirs) / statistics.median(ours), "least": min(each), "most": max(each)}
