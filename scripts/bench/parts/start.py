# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of a whole run from the shell, from the start of the launcher to its end."""

import json
import statistics
from collections.abc import Sequence
from pathlib import Path

from scripts.bench.bakers import Contender, race
from scripts.bench.versions import Version

SIZE = 2048


class Run(Contender):
    """A version that bakes a .blend into a PNG of 16 bits from the shell. reports: of all runs."""

    def __init__(self, version: Version, pair: Path, scratch: Path):
        self.version, self.pair, self.scratch, self.reports = version, pair, scratch, []
        super().__init__(version.name, self._bake, lambda: None)

    def _bake(self) -> float:
        output, report = self.scratch / "start.png", self.scratch / "start.json"
        output.unlink(missing_ok=True)
        words = ["--low", "lo", "--high", "hi", "--method", "flatten", "--size", SIZE, "--depth", 16]
        seconds = self.version.shell(self.pair, *words, "--output", output, "--report", report)
        self.reports.append(json.loads(report.read_text(encoding="utf-8")))
        return seconds

    def stages(self, key: str) -> dict[str, float]:
        """Median seconds of the stages that the reports have under this key, without the first run."""
        found = [report[key] for report in self.reports[1:] if report.get(key)]
        names = {name: None for stages in found for name in stages}
        return {name: statistics.median(stages.get(name, 0.0) for stages in found) for name in names}


def measure(pair: Path, versions: Sequence[Version], scratch: Path, repeats: int) -> list[dict]:
    """Run each version in turn."""
    field = [Run(version, pair, scratch) for version in versions]
    timed = race(field, repeats)
    return [
        {
            "what": "shell run, Flatten, PNG of 16 bits",
            "pair": pair.stem,
            "size": SIZE,
            "times": {name: vars(times) for name, times in timed.items()},
            "startup": {run.name: run.stages("startup") for run in field},
            "bake": {run.name: run.stages("seconds") for run in field},
        }
    ]
