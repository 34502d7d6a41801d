# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the container's root folder without Docker, and bakes in it as other users, read only. Debian, as root.

python3 scripts/dev/farms/try_container.py [--root FOLDER]

The lines of the Dockerfile are done in a folder that debootstrap fills, which takes some minutes and 2 GB; --root keeps it for
the next time. Then its entry runs in namespaces of its own, with a read-only root, a new /tmp, no rights, and user IDs that the
system does not know: each part of a job file, their merged report, wrong input, no graphics driver, and SIGTERM. The exit codes
must be those that the Kubernetes Job decides by.
"""

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import small_sets

DOCKERFILE = small_sets.FARM / "container" / "Dockerfile"
OF_THE_HOST = ("etc/resolv.conf", "etc/hosts", "etc/pip.conf", "etc/ssl/certs/ca-certificates.crt")
"""What a build takes from this machine to reach the package registries."""
SHARDS = 3


def instructions():
    """Yield the words of the Dockerfile: an instruction and the rest of its line."""
    text = re.sub(r"^#.*\n", "", DOCKERFILE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for line in text.replace("\\\n", " ").splitlines():
        if line.strip():
            yield line.split(maxsplit=1)


def mirror():
    """Return the address of Debian's packages that this machine uses."""
    release = re.search(r"^VERSION_CODENAME=(\w+)", Path("/etc/os-release").read_text(), re.MULTILINE)[1]
    folder = Path("/etc/apt")
    texts = [path.read_text() for path in [*folder.glob("sources.list.d/*"), folder / "sources.list"] if path.is_file()]
    for block in "\n\n".join(texts).split("\n\n"):
        found = re.search(rf"^deb (?:\[.*\] )?(\S+) {release} ", block, re.MULTILINE) or (
            re.search(rf"^Suites:.* {release}\b", block, re.MULTILINE)
            and re.search(r"^URIs: *(\S+)", block, re.MULTILINE)
        )
        if found:
            return found[1]
    raise SystemExit(f"the sources of apt have no {release}")


class Image:
    """A root folder with what the Dockerfile says of its processes."""

    def __init__(self, root):
        self.root, self.environment, self.entry = (
            root,
            {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"},
            [],
        )
        is_new = not (root / "built").exists()
        if is_new and root.exists():
            shutil.rmtree(root)
        for word, rest in instructions():
            if word == "ENV":
                self.environment.update(pair.split("=", 1) for pair in rest.split())
            elif word == "ENTRYPOINT":
                self.entry = json.loads(rest)
            elif word == "COPY" or (is_new and word in ("FROM", "RUN")):
                getattr(self, f"_{word.lower()}")(rest)
        (root / "built").touch()

    def _from(self, name):
        release = re.fullmatch(r"debian:(\w+)-slim", name)[1]
        run(["unshare", "--mount", "debootstrap", "--variant=minbase", release, str(self.root), mirror()])

    def _run(self, rest):
        for path in OF_THE_HOST:
            if Path("/", path).exists():
                (self.root / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(Path("/", path).resolve(), self.root / path)
        kept = {key: value for key, value in os.environ.items() if key != "PIP_FIND_LINKS"}
        environment = {**kept, **self.environment, "DEBIAN_FRONTEND": "noninteractive", "HOME": "/root"}
        mounts = "mount -t proc proc $0/proc; mount --rbind /dev $0/dev"
        run(
            ["unshare", "--mount", "sh", "-ec", f'{mounts}; exec chroot "$0" sh -c "$1"', str(self.root), rest],
            environment,
        )

    def _copy(self, rest):
        *sources, target = rest.split()
        for name in sources:
            source, place = small_sets.ROOT / name, self.root / target.lstrip("/")
            if source.is_dir():
                shutil.copytree(source, place, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
            else:
                place.mkdir(parents=True, exist_ok=True)
                shutil.copy(source, place)

    def start(self, work, user, *words, entry=None, **environment):
        """Start the entry as a user's ID, with a folder at /data. Returns the process."""
        mounts = (
            'mount --bind "$1" "$1"; mkdir -p "$1/data"; mount --bind "$2" "$1/data"; mount -t tmpfs tmpfs "$1/tmp"; '
            'mount --rbind /dev "$1/dev"; mount -t proc proc "$1/proc"; mount -o remount,bind,ro "$1"; cd "$1"; '
            "user=$3; shift 3; "
            'exec chroot . setpriv --reuid "$user" --regid "$user" --clear-groups --no-new-privs --bounding-set=-all "$@"'
        )
        namespaces = ["unshare", "--mount", "--pid", "--fork", "--kill-child=KILL", "--ipc", "--net", "--uts"]
        command = [
            *namespaces,
            "sh",
            "-ec",
            mounts,
            "sh",
            str(self.root),
            str(work),
            str(user),
            *(entry or self.entry),
            *words,
        ]
        return subprocess.Popen(
            command,
            env={**self.environment, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, work, user, *words, **environment):
        """Run the entry. Returns its exit code and output."""
        process = self.start(work, user, *words, **environment)
        output = process.communicate()[0]
        return process.returncode, output


def run(command, environment=None):
    """Run a step of the build."""
    done = subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(command)[:200]}: exit code {done.returncode}\n{done.stdout[-3000:]}")


def expect(wanted, result, what):
    """Print what came of a run, and yield a fault if its exit code is another one."""
    code, output = result
    print(f"exit code {code}: {what}")
    if code != wanted:
        yield f"{what}: exit code {code}, not {wanted}\n{output[-1500:]}"


def stopped(image, folder, user):
    """Send SIGTERM to the entry while it bakes. Returns its exit code and output."""
    process = image.start(folder, user, "--jobs", "/data/jobs.json")
    end = time.monotonic() + 60
    while not small_sets.maps(folder) and time.monotonic() < end:
        time.sleep(0.05)
    listed = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(process.pid)], stdout=subprocess.PIPE, text=True, check=False
    )
    os.kill(int(listed.stdout), signal.SIGTERM)
    output = process.communicate()[0]
    return process.returncode, output


def batch(folder, user, count):
    """Write a job file that a user may bake. Returns its folder."""
    small_sets.write(folder, count)
    for path in (folder, *folder.iterdir()):
        os.chown(path, user, user)
    return folder


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--root", type=Path, metavar="FOLDER", help="where the root folder is made, or was made before")
    options = parser.parse_args()
    if not shutil.which("debootstrap"):
        run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", "debootstrap"])
    with ExitStack() as held:
        folder = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="imprint-container-"))).resolve()
        folder.chmod(0o755)
        since = time.monotonic()
        image = Image((options.root or folder / "root").resolve())
        print(f"root folder: {time.monotonic() - since:.0f} s")
        found = []
        for user in (65532, 1234567):
            work = batch(folder / str(user), user, 8)
            touch = image.start(work, user, entry=["touch", "/opt/imprint/new"])
            touch.communicate()
            found += [] if touch.returncode else ["the root folder can be written to"]
            for index in range(SHARDS):
                given = {"SHARDS": str(SHARDS), "REPORTS": "/data/reports", "JOB_COMPLETION_INDEX": str(index)}
                result = image.run(work, user, "--jobs", "/data/jobs.json", **given)
                found += expect(0, result, f"user {user}, part {index + 1} of {SHARDS}")
            given = {"SHARDS": str(SHARDS), "REPORTS": "/data/reports"}
            found += expect(0, image.run(work, user, "merge", **given), "merge")
            found += small_sets.faults(work, 8, work / "reports" / "report.json", {})
        work = batch(folder / "codes", 65532, 40)
        found += expect(2, image.run(work, 65532, "--jobs", "/data/none.json"), "no job file")
        no_driver = {"__EGL_VENDOR_LIBRARY_DIRS": "/none"}
        found += expect(3, image.run(work, 65532, "--jobs", "/data/jobs.json", **no_driver), "no graphics driver")
        found += expect(143, stopped(image, work, 65532), "SIGTERM")
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
