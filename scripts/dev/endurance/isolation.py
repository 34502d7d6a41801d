# SPDX-License-Identifier: GPL-3.0-or-later
"""What processes of their own cost: small bakes in a worker and in the run's own process, in turns."""

import resource
import shutil
import statistics
import time
from pathlib import Path

from . import made_jobs

LEAST = 0.9
"""The rate in a worker over that in the run's own process, in the median of all pairs."""
MODES = ((), ("--resume",))


def run(folder: Path, count: int, seed: int, rounds: int = 5) -> tuple[list[str], list[str]]:
    """Prints each pair of runs. Returns lines with figures, and what is wrong."""
    made_jobs.make(folder, count, seed=seed)
    ratios: dict[str, list[float]] = {" ".join(more) or "without --resume": [] for more in MODES}
    wrong = []
    for place in range(rounds):
        for text, more in zip(ratios, MODES, strict=True):
            pair = {}
            for workers in (0, 1) if place % 2 else (1, 0):
                code, *pair[workers] = _timed(folder, "--workers", str(workers), *more)
                wrong += made_jobs.differences((code, 0, "the exit code"))
            (here, here_cpu), (there, there_cpu) = pair[0], pair[1]
            ratios[text].append(here / there)
            print(
                f"  {text}: {here:.2f} s in one process ({here_cpu:.2f} s of CPU), {there:.2f} s in a worker "
                f"({there_cpu:.2f} s of CPU), {here / there:.2f}",
                flush=True,
            )
    lines = [f"{count} bakes, rates in a worker over those in one process"]
    for text, found in ratios.items():
        middle = statistics.median(found)
        lines.append(f"  {text}: {middle:.2f} in the median of {rounds} pairs, {min(found):.2f} to {max(found):.2f}")
        if middle < LEAST:
            wrong.append(f"{text}: a rate of {middle:.2f} in a worker")
    return lines, wrong


def _timed(folder: Path, *words: str) -> tuple[int, float, float]:
    """The exit code of a run without earlier files, its seconds, and those of all its processes on CPUs."""
    shutil.rmtree(folder / "maps", ignore_errors=True)
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    code = made_jobs.start(folder, "--report", "report.json", *words).wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return code, time.perf_counter() - begun, cpu
