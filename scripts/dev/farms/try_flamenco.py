# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes on a real Flamenco on this machine: its manager and two workers, one of which is killed. Linux and macOS.

python3 scripts/dev/farms/try_flamenco.py FOLDER [--sets 40] [--shards 8]

FOLDER has the programs flamenco-manager and flamenco-worker of Flamenco 3. The manager compiles the job type; imprint.py farm
sends the job. In the middle of a part, a worker is killed with all that it started. The other one must do its task, no map may
be baked twice, the merged report must have all bakes, and the manager must have a preview. This takes seven minutes: a manager
looks for silent workers from its sixth minute on.
"""

import argparse
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from contextlib import ExitStack
from pathlib import Path

import small_sets

CONFIGURATION = """_meta: {{version: 3}}
manager_name: Test
database: flamenco-manager.sqlite
listen: 127.0.0.1:{port}
autodiscoverable: false
local_manager_storage_path: ./local
shared_storage_path: {folder}/storage
shaman: {{enabled: false}}
task_timeout: 10m
worker_timeout: {timeout}s
blocklist_threshold: 3
task_fail_after_softfail_count: 3
"""
WORKER_TIMEOUT = 20
"""Seconds after which the manager gives the task of a silent worker to another one."""
PATIENCE = 560.0
"""Seconds after which the job counts as hung."""
ENDED = ("completed", "failed", "canceled")


class Farm:
    """A manager and its workers in a folder of their own."""

    def __init__(self, programs, folder):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        self.folder, self._programs, self._running = folder, programs, {}
        (folder / "scripts").mkdir(parents=True)
        shutil.copy(small_sets.FARM / "flamenco" / "imprint_bake.js", folder / "scripts")
        shutil.copy(programs / "flamenco-manager", folder)  # it looks for scripts beside itself
        text = CONFIGURATION.format(port=port, folder=folder, timeout=WORKER_TIMEOUT)
        (folder / "flamenco-manager.yaml").write_text(text)

    def __enter__(self):
        self._start("manager", self.folder / "flamenco-manager", self.folder)
        for _ in range(100):
            try:
                self.get("version")
                return self
            except urllib.error.URLError:
                time.sleep(0.1)
        raise SystemExit(f"the manager does not answer: {(self.folder / 'manager.log').read_text()[-2000:]}")

    def __exit__(self, *_):
        for name in list(self._running):
            self.kill(name)

    def add_worker(self, name):
        """Start a worker."""
        home = self.folder / name
        home.mkdir()
        text = f"manager_url: {self.url}/\ntask_types: [blender, ffmpeg, file-management, misc]\n"
        (home / "flamenco-worker.yaml").write_text(text)
        self._start(name, self._programs / "flamenco-worker", home, HOME=str(home), FLAMENCO_WORKER_NAME=name)

    def _start(self, name, program, home, **environment):
        with (self.folder / f"{name}.log").open("w") as log:
            self._running[name] = subprocess.Popen(
                [str(program)],
                cwd=home,
                env={**os.environ, **environment},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def kill(self, name):
        """End a program with all that it started, without notice."""
        process = self._running.pop(name)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def get(self, path):
        """Ask the manager."""
        with urllib.request.urlopen(f"{self.url}/api/v3/{path}") as answer:
            return json.loads(answer.read() or b"null")

    def tasks(self, job):
        """Return the tasks of a job, by name, with their workers."""
        listed = self.get(f"jobs/{job}/tasks")["tasks"]
        return {task["name"]: self.get(f"tasks/{task['id']}") for task in listed}


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


def wait(farm, job):
    """Wait until the job ends. Returns its status."""
    end = time.monotonic() + PATIENCE
    while (status := farm.get(f"jobs/{job}")["status"]) not in ENDED and time.monotonic() < end:
        time.sleep(0.5)
    return status


def faults(farm, job, status, killed, name):
    """Yield what is wrong with the farm's side of the job."""
    tasks = farm.tasks(job)
    if status != "completed":
        yield f"the job is {status}"
        yield from (f"{each} is {task['status']}" for each, task in tasks.items() if task["status"] != "completed")
    if worker_of(tasks[name]) == killed:
        yield f"{name} was not done by the other worker"
    if not farm.get(f"jobs/{job}/last-rendered"):
        yield "no preview arrived"


def submit(farm, jobs, shards):
    """Send the job as a user does, and return its ID."""
    command = [*small_sets.LAUNCHER, "farm", "--flamenco", farm.url, str(jobs), "--shards", str(shards)]
    done = subprocess.run([*command, "--command", small_sets.COMMAND], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.returncode)
    return done.stdout.split()[-1].rsplit("/", 1)[-1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("programs", type=Path, metavar="FOLDER", help="with flamenco-manager and flamenco-worker")
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--shards", type=int, default=8)
    options = parser.parse_args()
    with ExitStack() as held:
        folder = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="imprint-flamenco-"))).resolve()
        jobs = small_sets.write(folder / "batch", options.sets)
        farm = held.enter_context(Farm(options.programs.resolve(), folder / "farm"))
        kind = farm.get("jobs/type/imprint-bake")
        print(f"compiled: {kind['label']}, {len(kind['settings'])} settings")
        for name in ("first", "second"):
            farm.add_worker(name)
        since = time.monotonic()
        job = submit(farm, jobs, options.shards)
        killed, name, before = kill_one(farm, job, jobs)
        print(f"killed: worker {killed!r} while it did {name}, with {len(before)} maps written")
        status = wait(farm, job)
        seconds = time.monotonic() - since
        done = {each: worker_of(task) for each, task in farm.tasks(job).items()}
        print(f"{status}: {len(done)} tasks in {seconds:.0f} s; {name} was done by {done[name]!r}")
        preview = farm.get(f"jobs/{job}/last-rendered")
        print(f"preview: {preview and preview['suffixes']}")
        merged = small_sets.reports(jobs) / "report.json"
        found = [*faults(farm, job, status, killed, name)]
        found += small_sets.faults(jobs.parent, options.sets, merged, before)
        if found:
            (Path.cwd() / "out").mkdir(exist_ok=True)
            kept = shutil.copytree(folder, Path.cwd() / "out" / f"flamenco-{os.getpid()}", symlinks=True)
            print(f"kept: {kept}")
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
