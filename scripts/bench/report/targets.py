# SPDX-License-Identifier: GPL-3.0-or-later
"""The targets of Imprint, which the figures of a run hold or miss."""

from collections.abc import Iterable, Iterator

from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN, MULTIRES, OUTERMOST, PEERS, PRESENT
from scripts.bench.report.statistics_of_rounds import older_name, ratios
from scripts.bench.report.verdicts import ORDER, Verdict, accuracy, at_least, at_most, linear

Found = list[tuple[str, dict[str, float] | None]]
"""Ratios with their names."""


def judge(result: dict) -> list[Verdict]:
    """The verdicts for all targets, missed ones first. result: a bench.json."""
    found = [*_of_pairs(result), *_of_versions(result), *_of_multires(result), *_of_live(result), *_of_samples(result)]
    found += [accuracy(row) for row in result.get("closed_forms", [])]
    for kind, points in result.get("growth", {}).items():
        if kind != "samples":
            found += [linear(kind, points, name) for name in (FLATTEN, CAST)]
    return sorted(found, key=lambda verdict: ORDER.index(verdict.outcome))


def _against(slower: str, faster: str, rows: Iterable[dict]) -> Found:
    return [(f"{row['pair']} at {row['size']}", ratios(row, slower, faster)) for row in rows]


def _of_pairs(result: dict) -> Iterator[Verdict]:
    """Against other bakers. The real pairs are those that are opened, or the terrains that stand for them."""
    real = [row for row in result.get("pairs", []) if row["samples"] == 1]
    rows = [*real, *(row for row in result.get("closed_forms", []) if CYCLES in row["times"])]
    terrains = [row for row in real if row["is_terrain"] and row["size"] == 2048]
    several = [row for row in result.get("pairs", []) if row["samples"] == 16]
    terrains_several = [row for row in several if row["is_terrain"] and row["size"] == 2048]
    yield at_least("Flatten 10 times faster than Cycles, terrains at 2048", 10.0, _against(CYCLES, FLATTEN, terrains))
    yield at_least("Cast no slower than Cycles, with a new tree for each bake", 1.0, _against(CYCLES, CAST, rows))
    for words, name, wanted in (("outermost hits", OUTERMOST, (3.0, 6.0)), ("own hits", CAST, (2.0, 4.0))):
        for size, times in zip((1024, 2048), wanted, strict=True):
            chosen = [row for row in real if row["size"] == size]
            target = f"Cast with {words} {times:g} times faster than Cycles at {size}, with a new tree for each bake"
            yield at_least(target, times, _against(CYCLES, name, chosen))
    yield at_least("Cast with 16 samples no slower than Cycles with 16", 1.0, _against(CYCLES, CAST, several))
    yield at_least(
        "Cast with 16 samples 3 times faster than Cycles with 16, terrains at 2048",
        3.0,
        _against(CYCLES, CAST, terrains_several),
    )
    yield at_least(
        "Cast's own hits take at most 1.6 times as long as outermost ones", 1 / 1.6, _against(OUTERMOST, CAST, rows)
    )
    yield at_least("Cast faster than Open3D", 1.0, _against(PEERS["open3d"], CAST, rows))


def _of_versions(result: dict) -> Iterator[Verdict]:
    """Against the older version."""
    yield _than_older("Bakes at most a tenth slower than with the older version", 1 / 1.1, result.get("bakes", []))
    png = [row for row in result.get("storing", []) if row["what"] == "PNG, 16 bits" and row["size"] == 2048]
    yield _than_older("Storing a PNG of 16 bits at 2048 in a quarter of the older version's time", 4.0, png)
    yield _than_older("A whole run from the shell in half of the older version's time", 2.0, result.get("start", []))
    many = [row for row in result.get("batches", []) if row["sets"] >= 200]
    yield _than_older("200 small bakes from a job file, twice as many a minute as the older version", 2.0, many)
    large = [row for row in result.get("memory", []) if row["triangles"] >= 10**7 and row["size"] == 512]
    cast = [row for row in large if row["method"] == CAST]
    yield _than_older("Cast of 10 million triangles at 512 in half of the older version's time", 2.0, cast)

    stored = [(row["what"], row["bytes"], older_name(row)) for row in result.get("storing", [])]
    larger = [(what, [sizes[PRESENT] / sizes[name]]) for what, sizes, name in stored if name and all(sizes.values())]
    yield at_most("Files at most 10 % larger than the older version's", 1.1, larger, "times")


def _of_samples(result: dict) -> Iterator[Verdict]:
    """Adaptive samples with all."""
    rows = result.get("samples", [])
    degrees = [
        (f"{row['what']}, {row['pair']} at {row['size']}, {row['samples']} samples", [row["angles"]["percentile_99"]])
        for row in rows
        if "angles" in row
    ]
    yield at_most("Adaptive samples within 0.02 degrees of all samples, 99th percentile", 0.02, degrees, "degrees")


def _than_older(target: str, wanted: float, rows: Iterable[dict]) -> Verdict:
    found = [
        (f"{row['what']}, {row.get('pair', 'grid')}", ratios(row, name, PRESENT))
        for row in rows
        if (name := older_name(row))
    ]
    return at_least(target, wanted, found)


def _of_multires(result: dict) -> Iterator[Verdict]:
    sculpts = [row for row in result.get("closed_forms", []) if MULTIRES in row["times"]]
    yield at_least("Flatten no slower than Blender's multires bake", 1.0, _against(MULTIRES, FLATTEN, sculpts))


def _of_live(result: dict) -> Iterator[Verdict]:
    for target, most, triangles in (
        ("Live, an update of 100,000 triangles at 1024 in 40 ms, without the image", 40.0, (90_000, 110_000)),
        ("Live, an update of a part of a million triangles in 100 ms, without the image", 100.0, (900_000, 1_100_000)),
    ):
        rows = [row for row in result.get("live", []) if triangles[0] <= row["triangles"] <= triangles[1]]
        found = [(f"{row['triangles']:,} triangles at {row['size']}", row["update_ms"]) for row in rows]
        yield at_most(target, most, found, "ms")
