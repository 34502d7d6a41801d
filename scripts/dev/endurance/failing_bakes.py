# SPDX-License-Identifier: GPL-3.0-or-later
"""A job in which bakes crash, take all memory and hang: all others are done, and memory does not grow."""

import time
from pathlib import Path

from . import made_jobs

GROWTH = 1.1
"""The parent's memory may be at most so many times that at the start."""
EVERY = 0.2
"""Seconds between two measurements of memory."""
MEBIBYTE = 1 << 20


def run(folder: Path, count: int, seed: int, workers: int = 1) -> tuple[list[str], list[str]]:
    """Returns lines with figures, and what is wrong."""
    names = made_jobs.make(folder, count, made_jobs.FAILING, seed)
    words = ("--report", "report.json", "--log", "logs", "--workers", str(workers), *made_jobs.LIMITS)
    begun = time.monotonic()
    process = made_jobs.start(folder, *words)
    parent: list[int] = []
    of_workers: dict[int, list[int]] = {}
    while process.poll() is None:
        parent.append(memory(process.pid))
        for child in made_jobs.children(process.pid):
            of_workers.setdefault(child, []).append(memory(child))
        time.sleep(EVERY)
    seconds = time.monotonic() - begun
    parent = [size for size in parent if size]
    entries = made_jobs.bakes(folder / "report.json")
    wrong = made_jobs.differences(
        (process.returncode, 1, "the exit code"),
        (made_jobs.failures(entries), made_jobs.expected_failures(names), "what failed"),
        (sum(each["state"] == "done" for each in entries), count - len(made_jobs.FAILING), "bakes that are done"),
        (len(made_jobs.maps(folder)), 2 * (count - len(made_jobs.FAILING)), "maps"),
        (sum(Path(each["log"]).is_file() for each in entries), count, "logs"),
    )
    lines = [f"{count} bakes in {seconds:.0f} s, {len(of_workers)} worker processes, exit code {process.returncode}"]
    lines += [f"  {each['name']}: {each['error']}" for each in entries if each["state"] == "failed"]
    lines.append(f"  memory of the parent: {_of(parent)}")
    steady = parent[len(parent) // 4 :]  # once it has read the job file
    if max(steady) > GROWTH * steady[0]:
        wrong.append(f"the parent's memory grows: {_of(steady)}")
    longest = max(of_workers.values(), key=len)
    longest = [size for size in longest if size][len(longest) // 2 :]  # once it has baked for a while
    lines.append(f"  memory of the worker that lived longest, from the middle of its life: {_of(longest)}")
    return lines, wrong


def memory(number: int) -> int:
    """The bytes of memory that a process has, or 0."""
    try:
        return int(Path(f"/proc/{number}/statm").read_text().split()[1]) * 4096
    except (OSError, IndexError):
        return 0


def _of(sizes: list[int]) -> str:
    first, last, most = (size / MEBIBYTE for size in (sizes[0], sizes[-1], max(sizes)))
    return f"{first:.0f} MiB at first, {last:.0f} MiB at last, {most:.0f} MiB at most"
