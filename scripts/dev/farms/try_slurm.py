# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes an array on a Slurm of one node on this machine, and requeues one of its tasks. Debian, as root.

python3 scripts/dev/farms/try_slurm.py [--sets 40] [--shards 8]

Slurm and MUNGE are installed from Debian's packages if they are missing. Their settings, sockets and logs are in a temporary
folder. In the middle of a part, its task is requeued. All maps must be there, none may be baked twice, and the merged report
must have all bakes.
"""

import argparse
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
AuthInfo=socket={folder}/munge.socket
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
"""Seconds after which the array counts as hung."""


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
        """Run a command of Slurm, and return what it prints."""
        environment = {**self.environment, **variables}
        return subprocess.run(
            command, env=environment, cwd=self._folder, stdout=subprocess.PIPE, text=True, check=False
        ).stdout.strip()


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
        since = time.monotonic()
        submit = str(small_sets.FARM / "slurm" / "submit.sh")
        sent = slurm.ask(submit, str(jobs), str(options.shards), IMPRINT_COMMAND=small_sets.COMMAND)
        print(sent)
        array = sent.split()[1].rstrip(",")
        task, before = requeue_one(slurm, array, jobs)
        print(f"requeued: task {task}, with {len(before)} maps written")
        while slurm.ask("squeue", "--noheader") and time.monotonic() - since < PATIENCE:
            time.sleep(1)
        again = slurm.ask("scontrol", "--oneliner", "show", "job", f"{array}_{task}")
        restarts = [word for word in again.split() if word.startswith("Restarts=")]
        print(f"done in {time.monotonic() - since:.0f} s; task {task}: {' '.join(restarts)}")
        found = [] if restarts == ["Restarts=1"] else [f"task {task} was not started again"]
        found += small_sets.faults(jobs.parent, options.sets, small_sets.reports(jobs) / "report.json", before)
        if found:
            for log in sorted(folder.glob("*.out")):
                print(f"{log.name}: {log.read_text()[-400:]}")
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
