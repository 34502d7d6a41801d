# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the workflows of .github/: steps name what is there, rights are few. The rest is actionlint's."""

import re
import shlex

import pytest

from scripts import imprint
from scripts.dev import blender_packages, run_workflow
from scripts.imprint import ROOT
from tests.pure.test_docs import known_options

WORKFLOWS = run_workflow.workflows()
JOBS = {f"{file}:{name}": job for file, workflow in WORKFLOWS.items() for name, job in workflow["jobs"].items()}
STEPS = [(name, step) for name, job in JOBS.items() for step in job.get("steps", [])]
RUNS = [(name, step["run"].strip()) for name, step in STEPS if "run" in step]
PROGRAMS = {"python", "python3", ".venv/bin/python", "bash", "go", "gh", "apt-get"}
FOREIGN = {"-r", "--constraint", "-qq", "--yes", "-q", "-m", "--notes-file", "--verify-tag", "--repo", "--check"}
"""Options of other programs than ours."""
WRITES = {
    "release:publish": {"contents": "write"},
    "manual:publish": {"pages": "write", "id-token": "write"},
}
"""The jobs that may do more than read the repository."""


# Steps


@pytest.mark.parametrize(("job", "text"), RUNS)
def test_a_step_names_what_is_there(job, text):
    for line in text.splitlines():
        words = shlex.split(run_workflow.filled(line, run_workflow.matrix_of(JOBS[job], {})), comments=True)
        assert words[0] in PROGRAMS
        assert [word for word in paths(words) if not (ROOT / word).exists()] == []
        if words[0] in {"go", "gh", "apt-get"}:
            continue
        options = {word for word in words[1:] if word.startswith("-")}
        assert options - FOREIGN - {"-n"} - known_options() == set()
        if "scripts/imprint.py" in words:
            imprint.parse(words[words.index("scripts/imprint.py") + 1 :])


def paths(words):
    """The words that name files of the repository."""
    made = (".venv/", "out/", "dist/", "dist")
    return [word for word in words if re.match(r"(scripts|tests|addon|docs|\.ci)/", word) and not word.startswith(made)]


# Blenders


def test_the_zip_is_installed_in_all_versions_that_are_tested():
    versions = JOBS["blenders:zip"]["strategy"]["matrix"]["blender"]
    pinned = re.search(
        r"^bpy==(.+)$", (ROOT / "scripts" / "requirements.txt").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert set(versions) == {*blender_packages.PYTHONS, pinned[1], "newest"}


def test_the_package_takes_no_blender_that_is_newer_than_those_tested():
    bound = re.search(r'"bpy>=4\.5,<(\d+)\.(\d+)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    major, minor, _ = map(int, blender_packages.NEWEST.split("."))
    assert tuple(map(int, bound.groups())) == (major, minor + 1)
    versions = [tuple(map(int, version.split("."))) for version in blender_packages.PYTHONS]
    assert max(versions) == tuple(map(int, blender_packages.NEWEST.split(".")))


def test_the_oldest_python_is_tested():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    oldest = re.search(r'requires-python = ">=([\d.]+)"', project)[1]
    assert JOBS["checks:pure"]["strategy"]["matrix"]["python"][0] == oldest


# Rights and actions


def test_only_jobs_that_publish_may_write():
    assert {file: workflow["permissions"] for file, workflow in WORKFLOWS.items()} == dict.fromkeys(
        WORKFLOWS, {"contents": "read"}
    )
    assert {name: job["permissions"] for name, job in JOBS.items() if "permissions" in job} == WRITES


@pytest.mark.parametrize("job", WRITES)
def test_a_job_that_may_write_runs_no_code_of_the_repository(job):
    used = [step.get("uses", "") for step in JOBS[job]["steps"]]
    assert [name for name in used if "checkout" in name] == []
    assert [text for name, text in RUNS if name == job and not text.startswith("gh ")] == []


def test_checkouts_keep_no_credentials():
    checkouts = [step for _, step in STEPS if step.get("uses", "").startswith("actions/checkout@")]
    assert checkouts
    assert {step["with"]["persist-credentials"] for step in checkouts} == {"false"}


def test_actions_are_pinned_by_commit_and_say_their_version():
    pins = {}
    for path in sorted(run_workflow.WORKFLOWS.glob("*.yml")):
        for line in re.findall(r"uses: (?!\./)(.+)", path.read_text(encoding="utf-8")):
            match = re.fullmatch(r"(actions/[\w-]+)@([0-9a-f]{40}) # (v\d+\.\d+\.\d+)", line)
            assert match, line
            pins.setdefault(match[1], set()).add((match[2], match[3]))
    assert pins
    assert {name: found for name, found in pins.items() if len(found) > 1} == {}
