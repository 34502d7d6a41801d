# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes an array on a Slurm of one node on this machine, and requeues one of its tasks. Debian, as root.

python3 scripts/dev/farms/try_slurm.py [--sets 40] [--shards 8]

Slurm and MUNGE are installed from Debian's packages if they are missing. Their settings, sockets and logs are in a temporary
folder. In the middle of a part, its task is requeued. All maps must be there, none may be baked twice, the merged report must
have all bakes, and both jobs the limit of time in SBATCH_TIMELIMIT. Then the maps of a part are removed, and the part is done
again alone. A task that always ends with exit code 3 must be requeued three times, and one with exit code 2 never.
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
from contextlib import ExitStack
from pathlib import Path

import small_sets

CONFIGURATION = """ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
KillWait=10
MpiDefault=none
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={processors} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
"""
PATIENCE = 400.0
"""Seconds after which jobs count as hung."""
ARRAY = str(small_sets.FARM / "slurm" / "bake_array.sh")


class Slurm:
    """A controller and a node in a folder of their own."""

    def __init__(self, folder):
        self._folder, self._running = folder, []
        self.environment = dict(os.environ, SLURM_CONF=str(folder / "slurm.conf"))
        sockets = [socket.socket() for _ in range(2)]
        for free in sockets:
            free.bind(("127.0.0.1", 0))
        ports = [free.getsockname()[1] for free in sockets]
        for free in sockets:
            free.close()
        for name in ("state", "spool"):
            (folder / name).mkdir()
        host = socket.gethostname().split(".", maxsplit=1)[0]
        text = CONFIGURATION.format(host=host, ports=ports, folder=folder, processors=os.cpu_count())
        (folder / "slurm.conf").write_text(text)

    def __enter__(self):
        key = self._folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        places = ("key-file", "log-file", "pid-file", "seed-file", "socket")
        own = [f"--{place}={self._folder}/munge.{place.split('-', maxsplit=1)[0]}" for place in places]
        self._start("munged", "--foreground", "--force", *own)
        while not (self._folder / "munge.socket").exists():
            time.sleep(0.1)
        self._start("slurmctld", "-D")
        self._start("slurmd", "-D")
        end = time.monotonic() + 60
        while "idle" not in self.ask("sinfo", "--noheader", "--format=%T"):
            if time.monotonic() > end:
                raise SystemExit("Slurm does not start:\n" + (self._folder / "slurmctld.log").read_text()[-2000:])
            time.sleep(0.5)
        return self

    def __exit__(self, *_):
        for process in reversed(self._running):
            process.send_signal(signal.SIGTERM)
            process.wait()

    def _start(self, *command):
        self._running.append(
            subprocess.Popen(
                command,
                env=self.environment,
                cwd=self._folder,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )

    def ask(self, *command, **variables):
        """Run a command of Slurm in the checkout, and return what it prints."""
        own = {"SBATCH_OUTPUT": str(self._folder / "%x-%j.out"), "SBATCH_TIMELIMIT": "60"}
        environment = {**self.environment, **own, **variables}
        return subprocess.run(
            command, env=environment, cwd=small_sets.ROOT, stdout=subprocess.PIPE, text=True, check=False
        ).stdout.strip()

    def wait(self):
        """Wait until all jobs have ended."""
        end = time.monotonic() + PATIENCE
        while self.ask("squeue", "--noheader") and time.monotonic() < end:
            time.sleep(0.5)

    def about(self, job):
        """Return what Slurm says about a job, by its names."""
        shown = self.ask("scontrol", "--oneliner", "show", "job", job)
        return dict(word.split("=", 1) for word in shown.split() if "=" in word)


def install():
    """Install Slurm if it is missing."""
    if not all(map(shutil.which, ("slurmctld", "slurmd", "sbatch", "munged"))):
        subprocess.run(["apt-get", "update", "-qq"], check=True)
        packages = ["slurm-wlm", "munge"]
        subprocess.run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *packages], check=True)


def requeue_one(slurm, array, jobs):
    """Requeue a task in the middle of a part of several bakes. Returns its number, and the maps until then."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for lines in small_sets.reports(jobs).glob("report.*.json.lines"):
            if lines.read_text().count("\n") in (1, 2, 3):
                task = lines.name.split(".")[1]
                slurm.ask("scontrol", "requeue", f"{array}_{task}")
                return task, small_sets.maps(jobs.parent)
        time.sleep(0.05)
    raise SystemExit("no task could be requeued while it baked")


def bake(slurm, jobs, sets, shards):
    """Send all parts, and requeue one. Yields what is wrong."""
    since = time.monotonic()
    submit = str(small_sets.FARM / "slurm" / "submit.sh")
    sent = slurm.ask(submit, str(jobs), str(shards), IMPRINT_COMMAND="python3 scripts/imprint.py bake")
    print(sent)
    array, merge = sent.replace(",", "").split()[1::2]
    task, before = requeue_one(slurm, array, jobs)
    print(f"requeued: task {task}, with {len(before)} maps written")
    slurm.wait()
    again = slurm.about(f"{array}_{task}")
    print(f"done in {time.monotonic() - since:.0f} s; task {task}: {again.get('Restarts')} restarts")
    if again.get("Restarts") != "1":
        yield f"task {task} was not started again"
    limits = [slurm.about(job).get("TimeLimit") for job in (f"{array}_1", merge)]
    if limits != ["01:00:00", "01:00:00"]:
        yield f"limits of time: {limits}"
    yield from small_sets.faults(jobs.parent, sets, small_sets.reports(jobs) / "report.json", before)


def bake_again(slurm, jobs, sets, shards):
    """Remove the maps of the second part, and do it alone. Yields what is wrong."""
    report = json.loads((small_sets.reports(jobs) / "report.2.json").read_text(encoding="utf-8"))
    maps = [Path(file["path"]) for entry in report["bakes"] for file in entry["files"] if file["what"] == "map"]
    for path in maps:
        path.unlink()
    before = small_sets.maps(jobs.parent)
    slurm.ask("sbatch", "--array=2", ARRAY, str(jobs), SHARDS=str(shards), IMPRINT_COMMAND=small_sets.COMMAND)
    slurm.wait()
    print(f"done again: {len(small_sets.maps(jobs.parent)) - len(before)} of {len(maps)} maps")
    yield from small_sets.faults(jobs.parent, sets, small_sets.reports(jobs) / "report.json", before)


def end_with(slurm, jobs, code, restarts):
    """Send a task that ends with this exit code. Yields what is wrong if it is not started again so many times."""
    sent = slurm.ask("sbatch", "--parsable", "--array=1", ARRAY, str(jobs), IMPRINT_COMMAND=f"sh -c 'exit {code}'")
    slurm.wait()
    found = slurm.about(f"{sent}_1")
    print(f"exit code {code}: {found.get('Restarts')} restarts, {found.get('JobState')}, {found.get('ExitCode')}")
    if (found.get("Restarts"), found.get("ExitCode")) != (str(restarts), f"{code}:0"):
        yield f"exit code {code}: {found.get('Restarts')} restarts, not {restarts}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--shards", type=int, default=8)
    options = parser.parse_args()
    install()
    with ExitStack() as held:
        folder = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="imprint-slurm-"))).resolve()
        jobs = small_sets.write(folder / "batch", options.sets)
        slurm = held.enter_context(Slurm(folder))
        found = [
            *bake(slurm, jobs, options.sets, options.shards),
            *bake_again(slurm, jobs, options.sets, options.shards),
            *end_with(slurm, jobs, 3, 3),
            *end_with(slurm, jobs, 2, 0),
        ]
        if found:
            for log in sorted(folder.glob("*.out")):
                print(f"{log.name}: {log.read_text()[-400:]}")
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
