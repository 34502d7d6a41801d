# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes on a real Flamenco on this machine: its manager and three workers, one of which is killed. Linux and macOS.

python3 scripts/dev/farms/try_flamenco.py FOLDER [--sets 40] [--shards 8]

FOLDER has the programs flamenco-manager and flamenco-worker of Flamenco 3. The manager compiles the job type; imprint.py farm
sends two jobs. The first one has no meshes: its check must fail, also at another worker, and nothing else begin. In the middle
of a part of the second one, a worker is killed with all that it started. Another one must do its task, no map may be baked
twice, the merged report must have all bakes, and the manager must have a preview. This takes six minutes: a manager looks for
silent workers from its sixth minute on.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import flamenco_manager
import small_sets

PATIENCE = 560.0
"""Seconds after which the job counts as hung."""


def worker_of(task):
    """Return the name of a task's worker."""
    return (task.get("worker") or {}).get("name", "")


def kill_one(farm, job, jobs):
    """Kill a worker in the middle of a part of several bakes. Returns its name, its task, and the maps until then."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for lines in small_sets.reports(jobs).glob("report.*.json.lines"):
            name = f"bake-{lines.name.split('.')[1]}-of-"
            task = next(task for each, task in farm.tasks(job).items() if each.startswith(name))
            if task["status"] == "active" and worker_of(task) and lines.read_text().count("\n") in (1, 2, 3):
                farm.kill(worker_of(task))
                return worker_of(task), task["name"], small_sets.maps(jobs.parent)
        time.sleep(0.1)
    raise SystemExit("no worker could be killed while it baked")


def fail(farm, folder, shards):
    """Send a job whose meshes are missing. Yields what is wrong if its check does not fail, and be tried again elsewhere."""
    jobs = small_sets.write(folder, shards)
    (folder / "high.obj").unlink()
    job = farm.submit(jobs, shards)
    status, tasks = farm.wait(job, PATIENCE), farm.tasks(job)
    tries = len(tasks["check"].get("failed_by_workers", ()))
    begun = [name for name, task in tasks.items() if worker_of(task)]
    print(f"without meshes: {status}, {tries} tries, begun: {', '.join(begun)}")
    if (status, tasks["check"]["status"], begun) != ("failed", "failed", ["check"]) or tries < 2:
        yield "the job without meshes did not fail at its check"


def faults(farm, job, status, killed, name):
    """Yield what is wrong with the farm's side of the job."""
    tasks = farm.tasks(job)
    if status != "completed":
        yield f"the job is {status}"
        yield from (f"{each} is {task['status']}" for each, task in tasks.items() if task["status"] != "completed")
    if worker_of(tasks[name]) == killed:
        yield f"{name} was not done by another worker"
    if not farm.get(f"jobs/{job}/last-rendered"):
        yield "no preview arrived"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("programs", type=Path, metavar="FOLDER", help="with flamenco-manager and flamenco-worker")
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--shards", type=int, default=8)
    options = parser.parse_args()
    with ExitStack() as held:
        folder = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="imprint-flamenco-"))).resolve()
        jobs = small_sets.write(folder / "batch", options.sets)
        farm = held.enter_context(flamenco_manager.Farm(options.programs.resolve(), folder / "farm"))
        kind = farm.get("jobs/type/imprint-bake")
        print(f"compiled: {kind['label']}, {len(kind['settings'])} settings")
        for name in ("first", "second", "third"):
            farm.add_worker(name)
        found = [*fail(farm, folder / "wrong", options.shards)]
        since = time.monotonic()
        job = farm.submit(jobs, options.shards)
        killed, name, before = kill_one(farm, job, jobs)
        print(f"killed: worker {killed!r} while it did {name}, with {len(before)} maps written")
        status = farm.wait(job, PATIENCE)
        seconds = time.monotonic() - since
        done = {each: worker_of(task) for each, task in farm.tasks(job).items()}
        print(f"{status}: {len(done)} tasks in {seconds:.0f} s; {name} was done by {done[name]!r}")
        preview = farm.get(f"jobs/{job}/last-rendered")
        print(f"preview: {preview and preview['suffixes']}")
        merged = small_sets.reports(jobs) / "report.json"
        found += [*faults(farm, job, status, killed, name)]
        found += small_sets.faults(jobs.parent, options.sets, merged, before)
        if found:
            (Path.cwd() / "out").mkdir(exist_ok=True)
            kept = shutil.copytree(folder, Path.cwd() / "out" / f"flamenco-{os.getpid()}", symlinks=True)
            print(f"kept: {kept}")
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
