# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches of small bakes in another process that signals stop, and what a stop must leave behind."""

import json
import os
import re
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

from scripts.imprint import ROOT

HERE = ROOT / "scripts"
LAUNCHER = [sys.executable, str(HERE / "imprint.py"), "bake"]
TARGETS = ("launcher", "Blender", "group")
PATIENCE = 60.0
"""Seconds after which a batch counts as hung."""

LOW = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


def write_sets(folder, count, size=64):
    """Write two small meshes and a job file that casts rays between them `count` times. Returns the command that bakes."""
    (folder / "low.obj").write_text(LOW)
    (folder / "high.obj").write_text(LOW.replace(" 0\n", " 0.1\n", 1))
    sets = [{"low-file": "low.obj", "high-file": "high.obj", "output": f"maps/{n:02}.png"} for n in range(count)]
    defaults = {"size": size, "method": "cast", "limit": 9}
    (folder / "jobs.json").write_text(json.dumps({"defaults": defaults, "bake": sets}))
    return [*LAUNCHER, "--jobs", str(folder / "jobs.json"), "--report", str(folder / "report.json")]


def is_whole(path):
    """Tell whether a PNG file has all its chunks, each with the right checksum."""
    data, at = path.read_bytes(), 8
    while at + 12 <= len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        body, check = data[at + 4 : at + 8 + size], data[at + 8 + size : at + 12 + size]
        if len(check) < 4 or zlib.crc32(body) != struct.unpack(">I", check)[0]:
            return False
        if kind == b"IEND":
            return at + 12 + size == len(data)
        at += 12 + size
    return False


def children(pid):
    """Return the process IDs of a process's children."""
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False)
    return [int(word) for word in listed.stdout.split()]


def is_bake(pid):
    """Tell whether a process runs scripts/bake.py: the launcher starts other processes before."""
    shown = subprocess.run(["ps", "-o", "args=", "-p", str(pid)], capture_output=True, text=True, check=False)
    return str(HERE / "bake.py") in shown.stdout


def send(process, number, target):
    """Send a signal. Returns False if the target process does not exist yet."""
    if target == "launcher":
        process.send_signal(number)
    elif target == "group":
        os.killpg(process.pid, number)
    else:
        bakes = [pid for pid in children(process.pid) if is_bake(pid)]
        for pid in bakes:
            os.kill(pid, number)
        return bool(bakes)
    return True


def group_lives(process, seconds=2.0):
    """Tell whether a process of the group still runs after this many seconds."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.02)
    return True


def start(command, folder):
    """Start a batch in a new process group, with its output in files."""
    with (folder / "out.txt").open("w") as out, (folder / "err.txt").open("w") as err:
        return subprocess.Popen(command, stdout=out, stderr=err, start_new_session=True)


def partials(folder):
    """Return the names of all hidden files in the maps' folder and beside the report."""
    return sorted(path.name for path in folder.rglob(".*"))


def faults(folder, code, number, process):
    """Yield what is wrong after a stop."""
    if code not in {128 + number, -number}:  # -number before Python has started; shells report both as 128 + number
        yield f"exit code {code}"
    if group_lives(process):
        yield "a process still runs"
    if partials(folder):
        yield f"left {partials(folder)}"
    maps = set(folder.glob("maps/*.png"))
    yield from (f"{path.name} is broken" for path in sorted(maps) if not is_whole(path))
    report = folder / "report.json"
    bakes = json.loads(report.read_text())["bakes"] if report.exists() else []
    listed = {Path(file["path"]) for bake in bakes for file in bake["files"]}
    if listed != maps or not all(bake["state"] == "done" for bake in bakes):
        yield f"the report lists {len(bakes)} bakes, but there are {len(maps)} maps"
    strange = [line for line in (folder / "err.txt").read_text().splitlines() if not line.startswith("imprint: ")]
    if strange:
        yield f"unexpected error output: {strange[:3]}"
    table = (folder / "out.txt").read_text().splitlines()
    if maps and not (table and re.match(rf"{len(maps)} done, 0 failed", table[-2])):
        yield "no table"
