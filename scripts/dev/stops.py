# SPDX-License-Identifier: GPL-3.0-or-later
"""Stops batches of small bakes at random moments, and checks what each stop leaves behind. Linux and macOS.

python3 scripts/dev/stops.py [--count 100] [--seed 0] [--signals INT,TERM] [--sets 40] [--kill 20]

One signal stops each batch. It is sent to the launcher, to Blender and to the whole process group in turn. Afterwards the
exit code must be 128 plus the signal's number, no process of the group may run, no partial file may be left, every map must
be complete and in the report, every map in the report must exist, and the error output must hold Imprint's messages only.
With --kill, that many batches are killed by SIGKILL instead, and a later bake in the same folder must remove their partial
files.
"""

import argparse
import json
import os
import random
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
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


def stop(folder, sets, moment, number, target):
    """Stop one batch after `moment` seconds. Returns a summary and the list of faults, or None if it ended before."""
    process = start(write_sets(folder, sets), folder)
    time.sleep(moment)
    while process.poll() is None and not send(process, number, target):
        time.sleep(0.01)
    since = time.monotonic()
    try:
        code = process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return "", [f"hung for {PATIENCE:.0f} s"]
    took = time.monotonic() - since
    if code == 0 and took < 0.01:
        return None
    maps = len(list(folder.glob("maps/*.png")))
    if code == 0 and maps == sets:  # the signal came after the last bake
        code = 128 + number
    return f"{maps} maps, stopped in {took:.2f} s", list(faults(folder, code, number, process))


def kill(folder, sets, moment, target):
    """Kill one batch, with larger maps, and bake once more in its folder. Returns as `stop` does."""
    process = start(write_sets(folder, sets, 1024), folder)
    time.sleep(moment)
    if process.poll() is not None:
        return None
    send(process, signal.SIGKILL, target)
    process.wait()
    wrong = ["a process still runs"] if group_lives(process, 10.0) else []  # Blender ends when its launcher is gone
    left = len(partials(folder))
    again = subprocess.run(write_sets(folder, 1), capture_output=True, text=True, check=False)
    wrong += [f"left {partials(folder)}"] if partials(folder) else []
    wrong += [f"the next run ended with {again.returncode}: {again.stderr}"] if again.returncode else []
    wrong += [f"{path.name} is broken" for path in folder.glob("maps/*.png") if not is_whole(path)]
    return f"left {left} files for the next run", wrong


def timed(sets):
    """Return the duration of a whole batch in seconds."""
    with tempfile.TemporaryDirectory(prefix="imprint-stops-") as name:
        begun = time.monotonic()
        subprocess.run(write_sets(Path(name), sets), stdout=subprocess.DEVNULL, check=True)
        return time.monotonic() - begun


def main():
    """Stop and kill batches. Returns exit code 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=100, help="batches to stop (default: 100)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (default: 0)")
    parser.add_argument("--signals", default="INT,TERM", help="to stop them with, in turn (default: INT,TERM)")
    parser.add_argument("--sets", type=int, default=40, help="bakes of a batch (default: 40)")
    parser.add_argument("--kill", type=int, default=0, help="batches to kill after that (default: 0)")
    options = parser.parse_args()
    numbers = [signal.Signals[f"SIG{name}"] for name in options.signals.split(",")]
    moments, whole = random.Random(options.seed), timed(options.sets)
    print(f"a whole batch takes {whole:.1f} s", flush=True)
    bad = 0
    for run in range(options.count + options.kill):
        number = numbers[run % len(numbers)] if run < options.count else signal.SIGKILL
        target = TARGETS[run // len(numbers) % len(TARGETS)]
        done = None
        while done is None:
            moment = moments.uniform(0.0, whole)
            with tempfile.TemporaryDirectory(prefix="imprint-stops-") as name:
                if run < options.count:
                    done = stop(Path(name), options.sets, moment, number, target)
                else:
                    done = kill(Path(name), options.sets, moment, target)
        bad += bool(done[1])
        print(f"{run:3} {number.name} to {target} after {moment:.2f} s: {'; '.join([done[0], *done[1]])}", flush=True)
    print(f"{options.count + options.kill - bad} right, {bad} wrong")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
