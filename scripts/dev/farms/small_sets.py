# SPDX-License-Identifier: GPL-3.0-or-later
"""Small bakes for trying farms, and what must be there when they are done."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
FARM = ROOT / "scripts" / "farm"
LAUNCHER = [sys.executable, str(ROOT / "scripts" / "imprint.py")]
COMMAND = os.environ.get("IMPRINT_COMMAND") or f'"{LAUNCHER[0]}" "{LAUNCHER[1]}" bake'
"""What starts Imprint on machines of farms: this checkout, or what IMPRINT_COMMAND says, as a Blender with the extension."""
LOW = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


def write(folder, count, size=512):
    """Write two meshes, and a job file that bakes them `count` times. Returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "low.obj").write_text(LOW)
    (folder / "high.obj").write_text(LOW.replace(" 0\n", " 0.1\n", 1))
    sets = [{"low-file": "low.obj", "high-file": "high.obj", "output": f"maps/{n:02}.png"} for n in range(1, count + 1)]
    jobs = folder / "jobs.json"
    jobs.write_text(json.dumps({"defaults": {"size": size, "method": "cast", "limit": 9, "samples": 4}, "bake": sets}))
    return jobs


def reports(jobs):
    """Return the folder that farms write the reports of a job file to."""
    return jobs.with_name(f"{jobs.stem}-reports")


def maps(folder):
    """Return the maps that are there, with what changes if one is written again."""
    found = {}
    for path in (folder / "maps").glob("[!.]*.png"):
        now = path.stat()
        found[path.name] = now.st_ino, now.st_mtime_ns
    return found


def faults(folder, count, merged, before):
    """Yield what is wrong after all bakes. merged: the merged report. before: maps that may not have changed since then."""
    now = maps(folder)
    if len(now) != count:
        yield f"{len(now)} of {count} maps are there"
    yield from (f"{name} was baked again" for name in sorted(before) if now.get(name) != before[name])
    yield from (f"left {path.name}" for path in sorted(folder.rglob("*.partial.*")))
    if not any(merged.with_name("logs").glob("*")):
        yield "no logs"
    missing = [f"no {path.name}" for path in (merged, merged.with_suffix(".html")) if not path.is_file()]
    if missing:
        yield from missing
        return
    bakes = json.loads(merged.read_text(encoding="utf-8"))["bakes"]
    if [bake["number"] for bake in bakes] != list(range(1, count + 1)):
        yield f"the merged report has {len(bakes)} bakes"
    yield from (f"{bake['name']}: {bake['error']}" for bake in bakes if bake["state"] not in ("done", "resumed"))


def program(name, package, folder):
    """Return the path of a Python package's program, which is installed into this folder if it is missing."""
    found = shutil.which(name)
    if found is None:
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        subprocess.run([str(folder / "bin" / "pip"), "install", "--quiet", package], check=True)
        found = folder / "bin" / name
    return str(found)


def finish(found):
    """Print the faults, and return the exit code."""
    for fault in found:
        print(f"wrong: {fault}")
    print("failed" if found else "passed")
    return 1 if found else 0
