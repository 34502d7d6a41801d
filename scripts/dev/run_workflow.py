#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the Linux steps of the workflows in .github/workflows here, in a fresh clone of what is committed.

    python3 scripts/dev/run_workflow.py [WORKFLOW[:JOB] ...] [--matrix KEY=VALUE ...] [--ref v0.3.0] [--list]

Each job has a clone of its own, in which its `run:` steps run in order until one fails. Of a matrix, the first value of each
key counts unless --matrix names another. A step that sets up Python, and a container that has one, become an environment of
that Python, from pyenv or the path. Other actions are left out, as are commands that this machine does not have, jobs of
other systems, and workflows that a job calls. PYTEST_ADDOPTS="-k NAME" in the environment makes the tests of all steps fewer.
"""

import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts.imprint import pyenv_roots  # noqa: E402

WORKFLOWS = ROOT / ".github" / "workflows"


# The part of YAML that these files use: blocks, scalars, lists in brackets, literal text


class Unreadable(ValueError):
    """A line is not in the part of YAML that is read here."""


def read_yaml(text: str) -> dict | list | str:
    """The mappings, lists and texts of a file. Everything plain is text, also numbers and `true`."""
    lines = _Lines(text)
    value = lines.block(0)
    if lines.peek() is not None:
        raise lines.wrong("is indented less than the line above needs")
    return value


class _Lines:
    def __init__(self, text: str):
        self._lines = text.splitlines()
        self._at = 0

    def wrong(self, why: str) -> Unreadable:
        return Unreadable(f"line {self._at + 1} {why}: {self._lines[self._at].strip()}")

    def peek(self) -> int | None:
        """The indentation of the next line with content, to which this moves, or None at the end."""
        while self._at < len(self._lines) and re.match(r"\s*(#|$)", self._lines[self._at]):
            self._at += 1
        if self._at == len(self._lines):
            return None
        line = self._lines[self._at]
        return len(line) - len(line.lstrip(" "))

    def block(self, indent: int) -> dict | list | str:
        if self._is_item():
            return list(self._items(indent))
        return self._mapping(indent)

    def _is_item(self) -> bool:
        return re.match(r" *-( |$)", self._lines[self._at]) is not None

    def _items(self, indent: int) -> Iterator[dict | list | str]:
        while self.peek() == indent and self._is_item():
            line = self._lines[self._at]
            content = line[indent + 1 :].lstrip(" ")
            if re.match(r"[\w.-]+:( |$)", content):
                self._lines[self._at] = " " * (len(line) - len(content)) + content
                yield self.block(len(line) - len(content))
            else:
                yield self._scalar(content)
                self._at += 1

    def _mapping(self, indent: int) -> dict:
        found = {}
        while self.peek() == indent and not self._is_item():
            match = re.fullmatch(r" *([\w.-]+):(?: +(.*))?", self._lines[self._at])
            if match is None:
                raise self.wrong("is no key with a value")
            key, content = match[1], match[2] or ""
            if key in found:
                raise self.wrong("has a key that is there already")
            found[key] = self._value(content, indent)
        if (self.peek() or 0) > indent:
            raise self.wrong("is indented more than the line above allows")
        return found

    def _value(self, content: str, indent: int) -> dict | list | str:
        if content and not content.startswith(("#", "|")):
            value = self._scalar(content)
            self._at += 1
            return value
        self._at += 1
        if content == "|":
            return self._literal(indent)
        below = self.peek()
        if below is not None and (below > indent or (below == indent and self._is_item())):
            return self.block(below)
        return ""

    def _literal(self, indent: int) -> str:
        start = self._at
        while self._at < len(self._lines) and re.match(rf" {{{indent + 1}}}|\s*$", self._lines[self._at]):
            self._at += 1
        return textwrap.dedent("\n".join(self._lines[start : self._at])).strip("\n") + "\n"

    def _scalar(self, content: str) -> list | dict | str:
        quoted = r'"(?:[^"\\]|\\.)*"'
        comment = r"(?: +#.*)?"
        if match := re.fullmatch(rf"({quoted}){comment}", content):
            return json.loads(match[1])
        if match := re.fullmatch(rf"\{{\}}{comment}", content):
            return {}
        if match := re.fullmatch(rf"\[(.*)\]{comment}", content):
            return [self._scalar(item) for item in re.findall(rf"{quoted}|[^,\s][^,]*", match[1])]
        plain = re.sub(r" +#.*$", "", content).strip()
        if re.match(r"""[\[\]{}&*!|>%@`'",?:]""", plain) or re.search(r":(\s|$)", plain):
            raise self.wrong("has a value of a kind that is not read here")
        return plain


# Workflows


def workflows() -> dict[str, dict]:
    """All workflows, by the name of the file without its ending."""
    return {path.stem: read_yaml(path.read_text(encoding="utf-8")) for path in sorted(WORKFLOWS.glob("*.yml"))}


def matrix_of(job: dict, chosen: dict[str, str]) -> dict[str, str]:
    """A value for each key of the job's matrix: the one that was chosen, or the first."""
    choices = job.get("strategy", {}).get("matrix", {})
    for key in choices.keys() & chosen.keys():
        if chosen[key] not in choices[key]:
            raise SystemExit(f"the matrix has no {key}={chosen[key]}, but {', '.join(choices[key])}")
    return {key: chosen.get(key, values[0]) for key, values in choices.items()}


def filled(text: str, matrix: dict[str, str]) -> str:
    """A text with the values of the matrix in place of its expressions. Other expressions become nothing."""
    return re.sub(r"\$\{\{ *(?:matrix\.([\w-]+)|[^}]*) *\}\}", lambda match: matrix.get(match[1] or "", ""), text)


def is_linux(job: dict, matrix: dict[str, str]) -> bool:
    return filled(job.get("runs-on", ""), matrix).startswith("ubuntu")


def variables(*places: dict, matrix: dict[str, str]) -> dict[str, str]:
    """The environment variables that a workflow, a job and a step set."""
    return {key: filled(value, matrix) for place in places for key, value in place.get("env", {}).items()}


def program(command: str) -> str:
    """The program that a command starts."""
    return next(word for word in shlex.split(command) if "=" not in word)


# Here


def python_environment(version: str, folder: Path) -> Path:
    """The folder with the programs of a new environment of this Python."""
    found = [str(path) for root in pyenv_roots() for path in root.glob(f"versions/{version}.*/bin/python")]
    base = next(filter(None, [*found, shutil.which(f"python{version}")]), None)
    if base is None:
        raise SystemExit(f"Python {version} is needed, and was not found")
    subprocess.run([base, "-m", "venv", str(folder)], check=True)
    return folder / "bin"


def python_for(job: dict, matrix: dict[str, str]) -> str:
    """The version of the Python that a job sets up, or that its container has, or ""."""
    wanted = [step["with"]["python-version"] for step in job["steps"] if "setup-python" in step.get("uses", "")]
    image = re.match(r"python:([\d.]+)", filled(job.get("container", {}).get("image", ""), matrix))
    return filled(wanted[-1], matrix) if wanted else image[1] if image else ""


def run_job(name: str, workflow: dict, job: dict, matrix: dict[str, str], ref: str) -> bool:
    """Run the steps of a job in a clone. Returns whether all that can run here ended well."""
    with tempfile.TemporaryDirectory(prefix="imprint-workflow-") as scratch:
        clone = Path(scratch) / "imprint"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        environment = {**os.environ, "CI": "true", "GITHUB_REF_NAME": ref}
        if version := python_for(job, matrix):
            path = python_environment(version, Path(scratch) / "python")
            environment["PATH"] = f"{path}{os.pathsep}{environment['PATH']}"
        for step in job["steps"]:
            if "run" not in step:
                print(f"{name}: left out: {step['uses'].partition('@')[0]}", flush=True)
                continue
            command = filled(step["run"], matrix).strip()
            if shutil.which(program(command), path=environment["PATH"]) is None:
                print(f"{name}: left out: {command}: no {program(command)} here", flush=True)
                continue
            print(f"{name}: {command}", flush=True)
            start = time.monotonic()
            shell = ["sh", "-e", "-c"] if "container" in job else ["bash", "-e", "-c"]
            own = environment | variables(workflow, job, step, matrix=matrix)
            code = subprocess.run(
                [*shell, command], cwd=clone, env=own, stdin=subprocess.DEVNULL, check=False
            ).returncode
            print(f"{name}: exit code {code} after {time.monotonic() - start:.0f} s: {command}", flush=True)
            if code:
                return False
    return True


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("chosen", nargs="*", metavar="WORKFLOW[:JOB]", help="default: all")
    parser.add_argument("--matrix", nargs="+", default=[], metavar="KEY=VALUE")
    parser.add_argument("--ref", default="main", help="the branch or tag that the steps see (default: main)")
    parser.add_argument("--list", action="store_true", help="print the jobs and steps, and run nothing")
    given = parser.parse_args()
    chosen = dict(word.split("=", 1) for word in given.matrix)
    failed = []
    for file, workflow in workflows().items():
        for own, job in workflow["jobs"].items():
            name = f"{file}:{own}"
            if given.chosen and not {file, name} & set(given.chosen):
                continue
            matrix = matrix_of(job, chosen)
            if not is_linux(job, matrix):
                where = filled(job.get("runs-on", "another workflow"), matrix)
                print(f"{name}: left out: it runs on {where}", flush=True)
            elif given.list:
                for step in job["steps"]:
                    print(f"{name}: {filled(step.get('run', step.get('uses', '')), matrix).strip()}")
            elif not run_job(name, workflow, job, matrix, given.ref):
                failed.append(name)
    print(f"failed: {', '.join(failed)}" if failed else "no step failed")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
