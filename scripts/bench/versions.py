# SPDX-License-Identifier: GPL-3.0-or-later
"""This version of Imprint and an older one, each in processes of its own that answer requests, so that they can take turns."""

import contextlib
import json
import subprocess
import sys
import tarfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from scripts.bench.comparing import PRESENT


class ChildError(RuntimeError):
    """The error message of a process, in one line."""


class Child:
    """A process that answers requests. Its standard error goes to the file `log`. Use it in a `with` block."""

    def __init__(self, command: Sequence[str], log: Path, environment: Mapping[str, str] | None = None):
        self.log = log
        with open(log, "w", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
            )

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, *_) -> None:
        with contextlib.suppress(BrokenPipeError):  # it has died
            self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def ask(self, **request) -> dict:
        """The answer to a request. Raises ChildError if it has an "error", or if the process has died."""
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise ChildError(f"the process died: {self._last_words()}")
        answer = json.loads(line)
        if "error" in answer:
            raise ChildError(answer["error"])
        return answer

    def _last_words(self) -> str:
        """The last line that the process wrote to its standard error."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"


ROOT = Path(__file__).resolve().parents[2]
HOME = ROOT / "out" / "bench" / "older"
RELEASE = "v0.2.0"
"""The tag of the last release, where the repository has no tag."""


class NoOlderVersion(Exception):
    """The older version cannot be checked out. Its text is the message."""


@dataclass(frozen=True)
class Version:
    """A version of Imprint. root: of its files."""

    name: str
    root: Path

    def worker(self, log: Path) -> Child:
        """A process that bakes with this version; see version_worker.py. log: where it writes its errors."""
        worker = Path(__file__).with_name("version_worker.py")
        return Child([sys.executable, str(worker), str(self.root)], log)

    def shell(self, *arguments: str | Path) -> float:
        """The seconds of `imprint.py bake` with these arguments, from its start to its end. Raises ChildError."""
        command = [sys._base_executable, str(self.root / "scripts" / "imprint.py"), "bake", *map(str, arguments)]
        start = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        seconds = time.perf_counter() - start
        if done.returncode:
            raise ChildError((done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1])
        return seconds


def versions(ref: str | None) -> list[Version]:
    """This version and, unless `ref` is None, the older one that it names. Raises NoOlderVersion."""
    present = Version(PRESENT, ROOT)
    return [present] if ref is None else [present, older(ref)]


def older(ref: str) -> Version:
    """The version at a commit or tag, checked out in out/bench/older; "" for the last release. Raises NoOlderVersion."""
    ref = ref or last_release()
    commit = _git(
        "rev-parse", "--verify", "--quiet", "--end-of-options", f"{ref}^{{commit}}", problem=f"has no {ref!r}"
    )
    root = HOME / commit
    if not (root / "scripts" / "imprint.py").is_file():
        _check_out(commit, root)
    environment = root / ".venv"
    requirements = "scripts/requirements.txt"
    if not environment.exists() and (root / requirements).read_bytes() == (ROOT / requirements).read_bytes():
        with contextlib.suppress(OSError):  # without the right to make links, it sets up its own at its first run
            environment.symlink_to(Path(sys.prefix), target_is_directory=True)
    return Version(f"{PRESENT} {ref}", root)


def last_release() -> str:
    try:
        return _git("describe", "--tags", "--abbrev=0", "--match=v*", problem="has no tag of a release")
    except NoOlderVersion:
        return RELEASE


def _check_out(commit: str, root: Path) -> None:
    """Write the files of a commit into a new folder."""
    root.mkdir(parents=True, exist_ok=True)
    archive = root.with_suffix(".tar")
    _git("archive", "--format=tar", f"--output={archive}", commit, problem=f"cannot read {commit}")
    with tarfile.open(archive) as files:
        files.extractall(root, filter="data")
    archive.unlink()


def _git(*arguments: str, problem: str) -> str:
    """The output of git. Raises NoOlderVersion, which says that the repository has this problem."""
    advice = "bench --against needs a commit or a tag of this repository"
    try:
        done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=False)
    except OSError as error:
        raise NoOlderVersion(f"git cannot be started: {error.strerror}; {advice}") from error
    if done.returncode:
        said = done.stderr.strip().splitlines()
        reason = f" ({said[-1]})" if said else ""
        raise NoOlderVersion(f"the repository in {ROOT} {problem}{reason}; {advice}")
    return done.stdout.strip()
