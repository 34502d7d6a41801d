#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the signs of parts with fresh bakes, after seeded edits of 12 kinds on each kind of object.

    .venv/bin/python scripts/bench/stale_signs.py [--edits 500] [--seed 1] [--kind NAME ...]

A sign is wrong if it calls maps true that a fresh bake makes otherwise, by one bit: that must never be. It alarms if it calls
maps changed that a fresh bake makes again. Prints both by kind of edit, and each of them in words.
"""

import argparse
import contextlib
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402

import addon  # noqa: E402
from tests.support import part_edits  # noqa: E402

STEPS = 10
"""Edits of one part, each after the other."""


def run(
    count: int,
    seed: int,
    folder: Path,
    *,
    kinds: Sequence[str] = (),
    edits: Sequence[str] = (),
    ways: Sequence[str] = ("at once",),
):
    """Judges of so many edits. kinds, edits, ways: some of those of part_edits; empty for all."""
    kinds, edits, ways = (
        list(some or every)
        for some, every in ((kinds, part_edits.KINDS), (edits, part_edits.EDITS), (ways, part_edits.WAYS))
    )
    rng, empty, number = np.random.default_rng(seed), str(folder / "empty.blend"), 0
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=empty, copy=True)
    while number < count:
        kind = kinds[rng.integers(len(kinds))]
        part_edits.new_file(empty)
        part = part_edits.make(kind, folder / f"part{number}", int(rng.integers(1 << 30)), empty)
        maps = part.bake()
        for _ in range(STEPS):
            way = ways[rng.integers(len(ways))]
            edit = edits[rng.integers(len(edits))]
            judged, maps = part_edits.judge(part, edit, rng, maps, way)
            if judged is not None:
                number += 1
                yield judged
            if maps is None:
                break


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--edits", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", action="append")
    parser.add_argument("--edit", action="append")
    parser.add_argument(
        "--way", action="append", help="what happens between an edit and the look, as save; ALL for all"
    )
    parser.add_argument("--all", action="store_true", help="print all, not only those that are wrong")
    options = parser.parse_args()
    gpu.init()
    addon.register()
    counts: Counter = Counter()
    with tempfile.TemporaryDirectory() as folder:
        ways = () if options.way == ["ALL"] else options.way or ["at once"]
        chosen = {"kinds": options.kind or (), "edits": options.edit or (), "ways": ways}
        for judged in run(options.edits, options.seed, Path(folder), **chosen):
            counts[judged.edit, judged.is_stale] += 1
            counts["missed"] += judged.is_missed
            counts["alarms"] += judged.is_alarm
            if options.all or judged.is_missed or judged.is_alarm:
                what = (
                    "MISSED"
                    if judged.is_missed
                    else "ALARM"
                    if judged.is_alarm
                    else "STALE"
                    if judged.is_stale
                    else "true"
                )
                print(f"{what}: {judged.kind}, {judged.edit}: {judged.did}: {judged.clauses}", flush=True)
    stale, true = (sum(counts[edit, is_stale] for edit in part_edits.EDITS) for is_stale in (True, False))
    for edit in part_edits.EDITS:
        print(f"{edit:15} {counts[edit, True]:4} stale {counts[edit, False]:4} true")
    print(
        f"{stale} stale, of which {counts['missed']} were called true; {true} true, {counts['alarms']} called changed"
    )
    with contextlib.suppress(RuntimeError):
        addon.unregister()
    return int(bool(counts["missed"] or counts["alarms"] > 0.02 * true))


if __name__ == "__main__":
    sys.exit(main())
