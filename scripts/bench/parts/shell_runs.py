# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of whole runs from the shell: one bake, with the stages of its start, and job files with many sets."""

import json
import shutil
import statistics
from collections.abc import Sequence
from pathlib import Path

from scripts.bench.bakers import Contender, race
from scripts.bench.versions import Version

START_SIZE, BATCH_SIZE = 2048, 1024
SETS, SETS_QUICK = 200, 20
"""Of one .blend."""
OPENED = 20
"""Sets that each open a .blend."""


class Run(Contender):
    """A version that bakes a .blend into a PNG of 16 bits from the shell. reports: of all runs."""

    def __init__(self, version: Version, pair: Path, scratch: Path):
        self.version, self.pair, self.scratch, self.reports = version, pair, scratch, []
        super().__init__(version.name, self._bake, lambda: None)

    def _bake(self) -> float:
        output, report = self.scratch / "start.png", self.scratch / "start.json"
        output.unlink(missing_ok=True)
        words = ["--low", "lo", "--high", "hi", "--method", "flatten", "--size", START_SIZE, "--depth", 16]
        seconds = self.version.shell(self.pair, *words, "--output", output, "--report", report)
        document = json.loads(report.read_text(encoding="utf-8"))
        # Older versions write the report of a single bake without the shape around it.
        self.reports += [one for entry in document.get("bakes", ()) for one in entry["reports"]] or [document]
        return seconds

    def stages(self, key: str) -> dict[str, float]:
        """Median seconds of the stages that the reports have under this key, without the first run."""
        found = [report[key] for report in self.reports[1:] if report.get(key)]
        names = {name: None for stages in found for name in stages}
        return {name: statistics.median(stages.get(name, 0.0) for stages in found) for name in names}


def start(pair: Path, versions: Sequence[Version], scratch: Path, repeats: int) -> list[dict]:
    """Run each version in turn, from the start of the launcher to its end."""
    field = [Run(version, pair, scratch) for version in versions]
    timed = race(field, repeats)
    return [
        {
            "what": "shell run, Flatten, PNG of 16 bits",
            "pair": pair.stem,
            "size": START_SIZE,
            "times": {name: vars(times) for name, times in timed.items()},
            "startup": {run.name: run.stages("startup") for run in field},
            "bake": {run.name: run.stages("seconds") for run in field},
        }
    ]


def batches(pair: Path, versions: Sequence[Version], scratch: Path, quick: bool, repeats: int) -> list[dict]:
    """Bake a small pair many times: with one .blend for all sets, and with two in turn, so that each set opens its file.

    The first run of each version counts: it is as long as the others.
    """
    other = scratch / f"other_{pair.name}"
    shutil.copy(pair, other)
    return [
        _batch(what, files, versions, scratch, count=count, repeats=repeats)
        for what, files, count in (
            ("one .blend", [pair], SETS_QUICK if quick else SETS),
            ("a .blend each", [pair, other], OPENED),
        )
    ]


def _batch(
    what: str, files: Sequence[Path], versions: Sequence[Version], scratch: Path, *, count: int, repeats: int
) -> dict:
    maps = scratch / "batch"
    sets = [{"file": str(files[n % len(files)]), "output": str(maps / f"{n}.png")} for n in range(count)]
    shared = {"low": "lo", "high": "hi", "method": "flatten", "size": BATCH_SIZE}
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
        "size": BATCH_SIZE,
        "sets": count,
        "times": {name: vars(times) for name, times in timed.items()},
    }
