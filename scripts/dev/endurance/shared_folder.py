# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of one job on one folder, one of them twice, at once and one after the other, give the files of one run."""

import json
import random
import subprocess
from pathlib import Path

from . import made_jobs

PARTS = (1, 2, 3, 4, 2)
"""The parts of four, in the order of their reports."""
OWN = {"seconds", "log", "startup", "timings", "memory", "state", "shard"}
"""Keys of a report that differ from run to run, and by who did a bake."""


def run(folder: Path, count: int, seed: int) -> tuple[list[str], list[str]]:
    """Returns lines with figures, and what is wrong."""
    one = folder / "one"
    made_jobs.make(one, count, seed=seed)
    made_jobs.start(one, "--resume", "--report", "report.json").wait()
    expected_maps, expected_report = made_jobs.maps(one), _comparable(one, one / "report.json")
    lines, wrong = [], []
    order = random.Random(seed).sample(range(len(PARTS)), len(PARTS))
    for name, batches in (("at once", [range(len(PARTS))]), (f"in the order {order}", [[place] for place in order])):
        where = folder / name.replace(" ", "_").partition("[")[0]
        made_jobs.make(where, count, seed=seed)
        codes = []
        for places in batches:
            words = [("--shard", f"{PARTS[place]}/4", "--report", f"part{place}.json") for place in places]
            codes += [process.wait() for process in [made_jobs.start(where, "--resume", *each) for each in words]]
        entries = [made_jobs.bakes(where / f"part{place}.json") for place in range(len(PARTS))]
        done = [each["number"] for part in entries for each in part if each["state"] == "done"]
        merged = merge(where)
        found = made_jobs.differences(
            (set(codes), {0}, "exit codes"),
            (merged, 0, "the exit code of report --merge"),
            (made_jobs.unlike(made_jobs.maps(where), expected_maps), [], "files that differ"),
            (sorted(done), list(range(1, count + 1)), "the numbers of bakes that were done"),
            (len(made_jobs.records(where)), count, "records"),
        )
        if not merged and _comparable(where, where / "merged.json") != expected_report:
            found.append("the merged report differs")
        wrong += [f"{name}: {each}" for each in found]
        lines.append(f"{count} bakes in five processes {name}: {' + '.join(str(_done(part)) for part in entries)} done")
    return lines, wrong


def merge(folder: Path) -> int:
    """Merge the reports of all parts. Returns the exit code."""
    parts = [str(folder / f"part{place}.json") for place in range(len(PARTS))]
    command = [*made_jobs.BAKE, "report", "--merge", str(folder / "merged.json"), *parts]
    return subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode


def _done(entries: list[dict]) -> int:
    return sum(each["state"] == "done" for each in entries)


def _comparable(folder: Path, report: Path) -> object:
    """A report without what differs from run to run, as if its folder were another one."""
    values = json.loads(report.read_text().replace(str(folder), "FOLDER"))
    values["bakes"].sort(key=lambda each: each["number"])
    values.pop("summary")
    return _without(values)


def _without(value):
    if isinstance(value, dict):
        return {key: _without(each) for key, each in value.items() if key not in OWN}
    return [_without(each) for each in value] if isinstance(value, list) else value
