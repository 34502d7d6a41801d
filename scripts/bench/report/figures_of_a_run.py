# SPDX-License-Identifier: GPL-3.0-or-later
"""Collects the figures of a run by name, so that two runs can be compared."""

from collections.abc import Iterator

from scripts.bench.contenders.names import OURS

LIVE = {"update_ms": "update", "image_ms": "image"}
UNLIKE = ("processor", "cores", "renderer", "backend", "blender")
"""What a machine must share with another one for their times to be comparable."""


def figures(result: dict, *, ours: bool = True) -> dict[str, list[float]]:
    """The rounds of each figure, by its name: seconds, or bytes at the peak. Less is better for all of them.

    result: a bench.json. ours: the figures of Imprint; otherwise those of the other bakers, older versions included.
    """
    return {name: rounds for name, baker, rounds in _all(result) if rounds and (baker in OURS) == ours}


def _all(result: dict) -> Iterator[tuple[str, str, list[float]]]:
    """The name of each figure, its baker and its rounds."""
    for part, rows in result.items():
        for row in rows if isinstance(rows, list) and part != "versions" else ():
            where = ", ".join([part, *_words(row)])
            for baker, timed in row.get("times", {}).items():
                yield f"{where}: {baker}", baker, timed["seconds"]
            for baker, peaks in row.get("peak_bytes", {}).items():
                yield f"{where}, peak memory: {baker}", baker, peaks
    for row in result.get("occlusion", []):
        where = f"occlusion, {row['pair']}, {row['size']}"
        yield f"{where}: {OURS[0]}", OURS[0], [row["seconds"]]
        yield f"{where}: Cycles", "Cycles", [row["cycles_seconds"]]
    for kind, points in result.get("growth", {}).items():
        for point in points:
            for baker, rounds in point["seconds"].items():
                yield f"growth by {kind}, {point['amount']:,}: {baker}", baker, rounds
    for row in result.get("live", []):
        for key, word in LIVE.items():
            rounds = [milliseconds / 1e3 for milliseconds in row[key]]
            yield f"live, {row['triangles']:,} triangles, {row['size']}, {word}: {OURS[0]}", OURS[0], rounds


def _words(row: dict) -> Iterator[str]:
    """What tells a row from others of its part."""
    for key in ("what", "pair", "size"):
        if key in row:
            yield str(row[key])
    if row.get("samples", 1) > 1:
        yield f"{row['samples']} samples"


def differences(old: dict, new: dict) -> list[str]:
    """Sentences about what makes the times of two runs hard to compare."""
    found = [
        f"{key} was {old['machine'].get(key)} and is {new['machine'].get(key)}"
        for key in UNLIKE
        if old["machine"].get(key) != new["machine"].get(key)
    ]
    if old["quick"] != new["quick"]:
        found.append("only one of the runs is quick")
    return found
