# SPDX-License-Identifier: GPL-3.0-or-later
"""The container, and the Jobs of Kubernetes that run it, call the command line as it is."""

import os
import re
import subprocess

import pytest

from addon.cli import run_report
from scripts import imprint
from tests.package.farms.farm_words import FARM, JOBS, add_program, check_merge, check_shard

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for Linux and macOS")
MANIFEST = (FARM / "kubernetes" / "bake_job.yaml").read_text(encoding="utf-8")
MERGE_MANIFEST = (FARM / "kubernetes" / "merge_job.yaml").read_text(encoding="utf-8")
DOCKERFILE = (FARM / "container" / "Dockerfile").read_text(encoding="utf-8")


def environment(manifest):
    """The variables that a Job sets."""
    return dict(re.findall(r'{name: (\w+), value: "?([^"}]+)"?}', manifest))


def arguments_of(manifest):
    """The words that a Job gives to the container's entry."""
    (words,) = re.findall(r"^ +args: \[(.+)\]", manifest, re.MULTILINE)
    return words.split(", ")


def run_entry(noted, tmp_path, monkeypatch, *words):
    """Run the container's entry. Returns the words that it gives to scripts/imprint.py."""
    program, calls = noted
    add_program(tmp_path / "bin", monkeypatch, "python3", f'#!/bin/sh\nexec {program} "$@"\n')
    subprocess.run(["sh", str(FARM / "container" / "entry.sh"), *words], check=True)
    assert calls()[-1][:2] == ["/opt/imprint/scripts/imprint.py", "bake"]
    return calls()[-1][2:]


def test_the_container_bakes_what_it_is_told_to(noted, tmp_path, monkeypatch):
    for name in ("SHARDS", "JOB_COMPLETION_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX"):
        monkeypatch.delenv(name, raising=False)
    assert run_entry(noted, tmp_path, monkeypatch, "--jobs", JOBS) == ["--jobs", JOBS]


@pytest.mark.parametrize("name", ["JOB_COMPLETION_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX"])
def test_the_container_bakes_a_part(noted, tmp_path, monkeypatch, name):
    values = environment(MANIFEST)
    for key, value in {**values, name: "4"}.items():
        monkeypatch.setenv(key, value)
    for given in ([], ["--force"]):
        words = run_entry(noted, tmp_path, monkeypatch, *arguments_of(MANIFEST), *given)
        place = {"jobs": "/data/jobs.toml", "reports": "/data/jobs-reports"}
        check_shard(words, 5, int(values["SHARDS"]), is_forced=bool(given), **place)


def test_the_container_merges_the_reports_of_all_parts(noted, tmp_path, monkeypatch):
    assert environment(MERGE_MANIFEST) == environment(MANIFEST)
    for key, value in environment(MERGE_MANIFEST).items():
        monkeypatch.setenv(key, value)
    words = run_entry(noted, tmp_path, monkeypatch, *arguments_of(MERGE_MANIFEST))
    check_merge(words, int(environment(MANIFEST)["SHARDS"]), "/data/jobs-reports")


def test_kubernetes_has_as_many_parts_as_pods():
    assert re.findall(r"^  completions: (\d+)", MANIFEST, re.MULTILINE) == [environment(MANIFEST)["SHARDS"]]


def test_kubernetes_decides_by_exit_codes():
    found = re.findall(r"action: (\w+)\n +onExitCodes: .* values: \[([\d, ]+)\]", MANIFEST)
    actions = sorted((int(code), action) for action, codes in found for code in codes.split(","))
    assert actions == [
        (run_report.FAILED, "Count"),
        (run_report.WRONG_USAGE, "FailJob"),
        (run_report.NO_MACHINE, "Count"),
        (run_report.GATE, "FailIndex"),
    ]


def test_the_container_has_the_libraries_that_blender_needs():
    words = set(DOCKERFILE.split())
    assert {packages[0] for packages in imprint.PACKAGES.values()} <= words


def test_the_container_copies_what_is_there():
    ignored = (FARM / "container" / "Dockerfile.dockerignore").read_text(encoding="utf-8")
    taken = set(re.findall(r"^!(.+)", ignored, re.MULTILINE))
    copied = {name for line in re.findall(r"^COPY (.+) \S+$", DOCKERFILE, re.MULTILINE) for name in line.split()}
    assert copied == taken
    assert [name for name in sorted(copied) if not (imprint.ROOT / name).exists()] == []
