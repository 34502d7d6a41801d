# SPDX-License-Identifier: GPL-3.0-or-later
"""Job files of many small bakes, of which some end their process, and runs of them."""

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
BAKE = [sys.executable, str(ROOT / "scripts" / "bake.py")]
SABOTAGE = ROOT / "tests" / "support" / "sabotage"
"""With it on PYTHONPATH, bakes fail as the names of their low meshes say."""
FAILING = ("crash", "crash", "crash", "fill", "fill", "hang")
CAUSES = {"crash": ("crash", "SIGSEGV"), "fill": ("memory", ""), "hang": ("timeout", "")}
"""The causes and signals in the report."""
LIMITS = ("--timeout", "15", "--max-memory", "1500M")

MESH = "v 0 0 {}\nv 1 0 {}\nv 1 1 {}\nv 0 1 {}\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


def make(folder: Path, count: int, failing: Sequence[str] = (), seed: int = 0) -> list[str]:
    """Write meshes and jobs.json: `count` bakes, each of another high mesh. failing: words for the names of some of them.

    Returns the names of the low meshes' files, without their ending.
    """
    folder.mkdir(parents=True)
    chance = random.Random(seed)
    names = [f"m{number:03}_low" for number in range(1, count + 1)]
    for place, word in zip(chance.sample(range(count), len(failing)), failing, strict=True):
        names[place] = f"{word}{place + 1:03}_low"
    sets = []
    for name in names:
        high = name.replace("_low", "_high")
        (folder / f"{name}.obj").write_text(MESH.format(0, 0, 0, 0))
        (folder / f"{high}.obj").write_text(MESH.format(*(round(chance.random() * 0.1, 4) for _ in range(4))))
        sets.append({"low-file": f"{name}.obj", "high-file": f"{high}.obj", "output": f"maps/{name}.png"})
    defaults = {"size": 64, "method": "cast", "maps": ["normal", "height"]}
    (folder / "jobs.json").write_text(json.dumps({"defaults": defaults, "bake": sets}))
    return names


def start(folder: Path, *words: str) -> subprocess.Popen:
    """Start a run of `make`'s job file in a process group of its own, with what it prints in the folder's log."""
    with (folder / "printed.log").open("ab") as log:
        return subprocess.Popen(
            [*BAKE, "--jobs", str(folder / "jobs.json"), *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=dict(os.environ, PYTHONPATH=str(SABOTAGE)),
            start_new_session=True,
        )


def maps(folder: Path) -> dict[str, str]:
    """The hashes of all files that bakes wrote, by their paths, but for records."""
    paths = (path for path in sorted((folder / "maps").rglob("*")) if path.is_file() and not is_record(path))
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def is_record(path: Path) -> bool:
    """Whether a file is a record of --resume."""
    return path.name.endswith(".imprint.json")


def records(folder: Path) -> dict[str, tuple[int, int]]:
    """All records, each with what changes when it is written again."""
    found = {}
    for path in (folder / "maps").glob("*.imprint.json"):
        facts = path.stat()
        found[path.name] = facts.st_ino, facts.st_mtime_ns
    return found


def bakes(path: Path) -> list[dict]:
    """The entries of a report in the order of their numbers."""
    return sorted(json.loads(path.read_bytes())["bakes"], key=lambda each: each["number"])


def unlike(one: dict[str, str], other: dict[str, str]) -> list[str]:
    """The paths of files that differ, or that only one has."""
    return sorted(path for path in {**one, **other} if one.get(path) != other.get(path))


def failures(entries: Collection[dict]) -> list[tuple[str, str, str]]:
    """The names, causes and signals of the bakes that failed."""
    return [(each["name"], each["cause"], each["signal"]) for each in entries if each["state"] == "failed"]


def expected_failures(names: Sequence[str]) -> list[tuple[str, str, str]]:
    """As `failures`, for a job file of `make`."""
    return [
        (f"set {number} ({name})", *cause)
        for number, name in enumerate(names, 1)
        for word, cause in CAUSES.items()
        if name.startswith(word)
    ]


def children(number: int) -> Iterator[int]:
    """The processes that a process has started, on Linux."""
    try:
        found = Path(f"/proc/{number}/task/{number}/children").read_text()
    except OSError:
        return
    yield from map(int, found.split())


def kill(number: int) -> bool:
    """Kill a process that may have ended. Returns whether it was there."""
    try:
        os.kill(number, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def differences(*pairs: tuple[object, object, str]) -> list[str]:
    """Sentences about pairs of what was found and what was expected that differ."""
    return [f"{what}: {found!r} instead of {expected!r}" for found, expected, what in pairs if found != expected]
