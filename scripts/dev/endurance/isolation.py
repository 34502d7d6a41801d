# SPDX-License-Identifier: GPL-3.0-or-later
"""What processes of their own cost: small bakes in workers and in the run's own process, in turns."""

import shutil
import statistics
import time
from pathlib import Path

from . import made_jobs

LEAST = 0.9
"""The rate in a worker over that in the run's own process."""


def run(folder: Path, count: int, seed: int, rounds: int = 5) -> tuple[list[str], list[str]]:
    """Returns lines with figures, and what is wrong."""
    made_jobs.make(folder, count, seed=seed)
    lines, wrong = [], []
    for more in ((), ("--resume",)):
        seconds: dict[int, list[float]] = {0: [], 1: []}
        for place in range(2 * rounds):
            workers = (place + place // 2) % 2  # which is first changes each round
            shutil.rmtree(folder / "maps", ignore_errors=True)
            begun = time.perf_counter()
            code = made_jobs.start(folder, "--report", "report.json", "--workers", str(workers), *more).wait()
            seconds[workers].append(time.perf_counter() - begun)
            wrong += made_jobs.differences((code, 0, "the exit code"))
        here, in_worker = (statistics.median(seconds[workers]) for workers in (0, 1))
        text = " ".join(more) or "without --resume"
        lines.append(
            f"{count} bakes {text}: {here:.2f} s in one process, {in_worker:.2f} s in a worker, {here / in_worker:.2f}"
        )
        if here / in_worker < LEAST:
            wrong.append(f"{text}: a rate of {here / in_worker:.2f} in a worker")
    return lines, wrong
