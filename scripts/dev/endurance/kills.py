# SPDX-License-Identifier: GPL-3.0-or-later
"""Kills workers and parents at random moments, and resumes: the files are those of a run that nothing disturbed."""

import random
import time
from pathlib import Path

from . import made_jobs

LONGEST = 4.0
"""Seconds between two kills, once a run bakes, and at most."""


def run(folder: Path, count: int, seed: int, kills: int = 10, workers: int = 1) -> tuple[list[str], list[str]]:
    """Returns lines with figures, and what is wrong."""
    expected = folder / "undisturbed"
    names = made_jobs.make(expected, count, made_jobs.FAILING, seed)
    made_jobs.start(expected, "--report", "report.json", *made_jobs.LIMITS).wait()
    disturbed = folder / "disturbed"
    made_jobs.make(disturbed, count, made_jobs.FAILING, seed)
    story = _Story(disturbed, workers)
    chance = random.Random(seed)
    for _ in range(kills):
        story.kill(is_parent=chance.random() < 0.5, after=chance.random() * LONGEST)
    story.end()
    entries = made_jobs.bakes(disturbed / "report.json")
    good = [name for name in names if not name.startswith(tuple(made_jobs.CAUSES))]
    wrong = [*story.wrong] + made_jobs.differences(
        (made_jobs.unlike(made_jobs.maps(disturbed), made_jobs.maps(expected)), [], "files that differ"),
        (made_jobs.failures(entries), made_jobs.expected_failures(names), "what failed"),
        (len(made_jobs.records(disturbed)), len(good), "records"),
        (sorted({path.suffix for path in (disturbed / "maps").iterdir()}), [".json", ".png"], "kinds of files"),
    )
    more = sum(story.begun.get(name, 0) - 1 for name in good)
    if more > len(story.killed):
        wrong.append(f"{more} bakes were begun again after {len(story.killed)} kills")
    lines = [
        f"{count} bakes, seed {seed}, killed: {', '.join(story.killed)}",
        f"  {story.runs} runs; {more} bakes were begun again, none that had a record; "
        f"{len(made_jobs.maps(disturbed))} files are equal to those of a run without kills",
    ]
    return lines, wrong


class _Story:
    """A job that is killed and resumed until it is done."""

    def __init__(self, folder: Path, workers: int):
        self._folder, self._workers = folder, workers
        self.killed: list[str] = []
        self.wrong: list[str] = []
        self.runs = 0
        self.begun: dict[str, int] = {}
        """How often each bake was begun, by the names of low meshes."""
        self._records: dict[str, tuple[int, int]] = {}
        self._start()

    def kill(self, *, is_parent: bool, after: float) -> None:
        """Kill the parent or a worker, some seconds after bakes have begun. A killed parent is started again at once."""
        if self._process.poll() is not None:
            self._start()
        time.sleep(after)
        number = self._process.pid if is_parent else next(made_jobs.children(self._process.pid), 0)
        if number and made_jobs.kill(number):
            self.killed.append(f"{'parent' if is_parent else 'worker'} after {after:.2f} s")
        if is_parent:
            self._process.wait()
            self._start()

    def end(self) -> None:
        """Let it end, and resume once more, since killed workers are failures."""
        self._process.wait()
        self._start()
        self._process.wait()
        self._look()

    def _start(self) -> None:
        self._look()
        self.runs += 1
        self._logs = self._folder / "logs" / str(self.runs)
        words = ("--resume", "--report", "report.json", "--log", str(self._logs), "--workers", str(self._workers))
        self._process = made_jobs.start(self._folder, *words, *made_jobs.LIMITS)
        while self._process.poll() is None and not (self._logs.is_dir() and any(self._logs.iterdir())):
            time.sleep(0.01)

    def _look(self) -> None:
        """Count what the run before began, and see that it did nothing again that was done."""
        if not self.runs:
            return
        for log in self._logs.glob("*.log"):
            name = log.stem.split("_", 3)[-1]
            self.begun[name] = self.begun.get(name, 0) + 1
        now = made_jobs.records(self._folder)
        again = [name for name, facts in self._records.items() if now.get(name) != facts]
        if again:
            self.wrong.append(f"done twice: {again}")
        self._records = now
