# SPDX-License-Identifier: GPL-3.0-or-later
"""A Flamenco Manager with its workers on this machine, in a folder of its own."""

import json
import os
import shutil
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request

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
variables:
  blender: {{values: [{{platform: linux, value: blender}}, {{platform: darwin, value: blender}}]}}
"""
WORKER_TIMEOUT = 20
"""Seconds after which the manager gives the task of a silent worker to another one."""
ENDED = ("completed", "failed", "canceled")
"""How a job is when it goes on no more."""


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
        """Start a worker, and wait until it asks for tasks."""
        home = self.folder / name
        home.mkdir()
        text = f"manager_url: {self.url}/\ntask_types: [blender, ffmpeg, file-management, misc]\n"
        (home / "flamenco-worker.yaml").write_text(text)
        self._start(name, self._programs / "flamenco-worker", home, HOME=str(home), FLAMENCO_WORKER_NAME=name)
        for _ in range(100):
            workers = self.get("worker-mgt/workers")["workers"]
            if any((worker["name"], worker["status"]) == (name, "awake") for worker in workers):
                return
            time.sleep(0.1)
        raise SystemExit(f"the worker {name!r} does not wake up: {(self.folder / f'{name}.log').read_text()[-2000:]}")

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

    def submit(self, jobs, shards):
        """Send a job file as a user does, for workers that have this checkout. Returns the job's ID."""
        command = [*small_sets.LAUNCHER, "farm", "--flamenco", self.url, str(jobs), "--shards", str(shards)]
        done = subprocess.run(
            [*command, "--command", small_sets.COMMAND], stdout=subprocess.PIPE, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(done.returncode)
        return done.stdout.split()[-1].rsplit("/", 1)[-1]

    def wait(self, job, patience):
        """Wait until a job ends, or for these seconds. Returns its status."""
        end = time.monotonic() + patience
        while (status := self.get(f"jobs/{job}")["status"]) not in ENDED and time.monotonic() < end:
            time.sleep(0.5)
        return status
