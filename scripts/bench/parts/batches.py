# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a minute from a job file with many sets."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from scripts.bench.bakers import Contender, race
from scripts.bench.versions import Version

SETS, SETS_QUICK = 200, 20
"""Of one .blend."""
OPENED = 20
"""Sets that each open a .blend."""
SIZE = 1024


def measure(pair: Path, versions: Sequence[Version], scratch: Path, quick: bool, repeats: int) -> list[dict]:
    """Bake a small pair many times: with one .blend for all sets, and with two in turn, so that each set opens its file.

    The first run of each version counts: it is as long as the others.
    """
    other = scratch / f"other_{pair.name}"
    shutil.copy(pair, other)
    return [
        _row(what, files, versions, scratch, count=count, repeats=repeats)
        for what, files, count in (
            ("one .blend", [pair], SETS_QUICK if quick else SETS),
            ("a .blend each", [pair, other], OPENED),
        )
    ]


def _row(
    what: str, files: Sequence[Path], versions: Sequence[Version], scratch: Path, *, count: int, repeats: int
) -> dict:
    maps = scratch / "batch"
    sets = [{"file": str(files[n % len(files)]), "output": str(maps / f"{n}.png")} for n in range(count)]
    shared = {"low": "lo", "high": "hi", "method": "flatten", "size": SIZE}
    jobs = scratch / "jobs.json"
    jobs.write_text(json.dumps({"defaults": shared, "bake": sets}), encoding="utf-8")

    def run(version: Version) -> float:
        shutil.rmtree(maps, ignore_errors=True)
        return version.shell("--jobs", jobs, "--report", scratch / "jobs_report.json")

    field = [Contender(version.name, lambda version=version: run(version), lambda: None) for version in versions]
    timed = race(field, repeats, warm_up=False)
    shutil.rmtree(maps, ignore_errors=True)
    return {
        "what": f"{count} sets, {what}",
        "pair": files[0].stem,
        "size": SIZE,
        "sets": count,
        "times": {name: vars(times) for name, times in timed.items()},
    }
