# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the workflows and forms of .github/: they can be read, steps name what is there, rights are few. The rest is
actionlint's."""

import re
import shlex

import pytest

from scripts import imprint
from scripts.dev import blender_packages, run_workflow
from scripts.imprint import ROOT
from tests.pure.test_docs import known_options

GITHUB = ROOT / ".github"
FILES = sorted([*GITHUB.rglob("*.yml"), ROOT / "CITATION.cff"])
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


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_files_can_be_read(path):
    assert run_workflow.read_yaml(path.read_text(encoding="utf-8"))


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


def test_steps_name_files():
    """Otherwise the test above would look at nothing."""
    named = {word for _, text in RUNS for word in paths(shlex.split(text, comments=True))}
    assert {
        "scripts/imprint.py",
        "scripts/dev/in_blender.py",
        "scripts/dev/release.py",
        ".ci/run",
        "tests/pure",
    } <= named


def test_the_suite_is_what_continuous_integration_runs():
    assert ("checks:suite", 'bash .ci/run -m "not shared"') in [(job, text.split(" #")[0]) for job, text in RUNS]


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


def test_jobs_end():
    assert [name for name, job in JOBS.items() if "uses" not in job and "timeout-minutes" not in job] == []


# Reading


def test_yaml_is_read():
    text = """
# a comment
name: One: "two"
"""
    with pytest.raises(run_workflow.Unreadable, match="line 3"):
        run_workflow.read_yaml(text)
    text = """
on: # a comment
  push:
    tags: ["v*", main, "a, b"]
  pull_request:
empty: {}
list:
- plain # a comment
- key: value
  other:
    - deeper
text: |
  first

    second # no comment
next: "a \\"quote\\"" # a comment
"""
    assert run_workflow.read_yaml(text) == {
        "on": {"push": {"tags": ["v*", "main", "a, b"]}, "pull_request": ""},
        "empty": {},
        "list": ["plain", {"key": "value", "other": ["deeper"]}],
        "text": "first\n\n  second # no comment\n",
        "next": 'a "quote"',
    }


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\na: 2",
        "a: 1\n  b: 2",
        "a:\n    b: 1\n  c: 2",
        "a: &anchor 1",
        "a: *anchor",
        "a: >\n  folded",
        "a: {b: 1}",
        "a: 'single'",
        "a: b: c",
        "just words",
        "  a: 1\nb: 2",
    ],
)
def test_what_is_not_read_is_an_error(text):
    with pytest.raises(run_workflow.Unreadable, match=r"^line \d"):
        run_workflow.read_yaml(text)


# Running


def test_values_of_the_matrix_are_chosen():
    job = {
        "strategy": {
            "fail-fast": "false",
            "matrix": {"python": ["3.11", "3.12"], "system": ["ubuntu-24.04", "macos-15"]},
        }
    }
    assert run_workflow.matrix_of(job, {}) == {"python": "3.11", "system": "ubuntu-24.04"}
    chosen = run_workflow.matrix_of(job, {"python": "3.12", "other": "x"})
    assert chosen == {"python": "3.12", "system": "ubuntu-24.04"}
    with pytest.raises(SystemExit, match=r"python=3\.10"):
        run_workflow.matrix_of(job, {"python": "3.10"})
    assert run_workflow.filled("a ${{ matrix.python }} b ${{ github.token }}c", chosen) == "a 3.12 b c"
    job["runs-on"] = "${{ matrix.system }}"
    assert run_workflow.is_linux(job, chosen)
    assert not run_workflow.is_linux(job, {"system": "macos-15"})


def test_the_python_of_a_job_is_found():
    assert run_workflow.python_for(JOBS["checks:pure"], {"python": "3.12"}) == "3.12"
    assert run_workflow.python_for(JOBS["checks:suite"], {}) == "3.13"
    assert run_workflow.python_for({"steps": []}, {}) == ""


def test_the_program_of_a_command_is_found():
    assert run_workflow.program("A=1 B=2 gh release") == "gh"
