# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the scripts for farms call the command line as it is: a program that notes its words stands for Imprint."""

import json
import os
import re
import shutil
import subprocess
import sys

import pytest

from addon.cli import command
from addon.cli.farms import farm_command
from addon.cli.results import exit_codes, report_command
from addon.cli.usage import arguments
from addon.farms import flamenco
from scripts import imprint

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for Linux and macOS")

FARM = imprint.ROOT / "scripts" / "farm"
NOTES = """import json, os, sys
with open(os.environ["NOTED"], "a") as file:
    print(json.dumps(sys.argv[1:]), file=file)
sys.exit(int(os.environ.get("CODE", 0)))
"""
MANIFEST = (FARM / "kubernetes" / "bake_job.yaml").read_text(encoding="utf-8")
DOCKERFILE = (FARM / "container" / "Dockerfile").read_text(encoding="utf-8")
JOBS = "/a folder/jobs.toml"
REPORTS = "/a folder/jobs-reports"


@pytest.fixture
def noted(tmp_path, monkeypatch):
    """What starts the program that notes its words, and a function that returns these words, call by call."""
    program, file = tmp_path / "note words.py", tmp_path / "noted"
    program.write_text(NOTES)
    monkeypatch.setenv("NOTED", str(file))
    return f'"{sys.executable}" "{program}"', lambda: list(map(json.loads, file.read_text().splitlines()))


def add_program(folder, monkeypatch, name, text):
    """Put a program before those of the system."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH'].removeprefix(f'{folder}{os.pathsep}')}")


def check_shard(words, shard, shards, *, jobs=JOBS, reports=REPORTS, is_forced=False, size=None):
    """The words of a part are the command line's, and say what they should."""
    run, rest = arguments.split_jobs(words)
    assert (run.jobs, run.shard, run.report) == (jobs, (shard, shards), f"{reports}/report.{shard}.json")
    assert (run.resume, run.force, run.log) == (not is_forced, is_forced, f"{reports}/logs")
    assert arguments.parse(rest).size == (size or arguments.parse([]).size)


def check_first(words, size=None):
    """The words check all bakes with their options."""
    run, rest = arguments.split_jobs(words)
    assert (run.jobs, run.check, run.shard) == (JOBS, True, None)
    assert arguments.parse(rest).size == (size or arguments.parse([]).size)


def check_merge(words, shards, reports=REPORTS):
    """The words merge the reports of all parts."""
    assert words[0] == command.REPORT
    merge = report_command.parser("imprint").parse_intermixed_args(words[1:])
    parts = [f"{reports}/report.{shard}.json" for shard in range(1, shards + 1)]
    assert (merge.merge, merge.reports) == (f"{reports}/report.json", parts)


# Flamenco

RUN_JOB_TYPE = """
const nodePath = require("path").posix;
const path = {...nodePath, stem: name => nodePath.parse(name).name};
const author = {
    Task: (name, type) => ({name, type, commands: [], needs: [],
        addCommand(command) { this.commands.push(command); }, addDependency(task) { this.needs.push(task.name); }}),
    Command: (name, parameters) => ({name, ...parameters}),
};
const print = () => {};
const tasks = [];
SCRIPT
const unknown = Object.keys(SETTINGS).filter(key => !JOB_TYPE.settings.some(each => each.key === key));
if (unknown.length) throw new Error(`no settings: ${unknown}`);
const usual = Object.fromEntries(JOB_TYPE.settings.filter(each => "default" in each).map(each => [each.key, each.default]));
compileJob({settings: {...usual, ...SETTINGS}, addTask: task => tasks.push(task)});
console.log(JSON.stringify(tasks));
"""


def compiled(**settings):
    """The tasks of the job type, as Flamenco Manager would make them."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node.js is not installed")
    script = (FARM / "flamenco" / "imprint_bake.js").read_text(encoding="utf-8")
    program = RUN_JOB_TYPE.replace("SETTINGS", json.dumps(settings)).replace("SCRIPT", script)
    done = subprocess.run([node, "-"], input=program, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def words_of(task):
    """The command of a task, as a worker starts it."""
    (given,) = task["commands"]
    assert (task["type"], given["name"]) == ("blender", "blender-render")
    assert given["exe"] and given["blendfile"], "a worker refuses a task without"
    return [given["exe"], *given["argsBefore"], given["blendfile"], *given["args"]]


def test_flamenco_checks_then_bakes_then_merges():
    check, *bakes, merge = compiled(jobs=JOBS, shards=3)
    blender = ["{blender}", "--background", "--command", "imprint"]
    assert words_of(check)[:4] == blender
    check_first(words_of(check)[4:])
    for number, task in enumerate(bakes, 1):
        assert task["needs"] == ["check"]
        assert words_of(task)[:4] == blender
        check_shard(words_of(task)[4:], number, 3)
    assert merge["needs"] == [task["name"] for task in bakes]
    check_merge(words_of(merge)[4:], 3)


def test_flamenco_compiles_what_farm_sends(tmp_path, monkeypatch):
    jobs = tmp_path / "a job.toml"
    jobs.write_text('[[bake]]\nlow-file = "low.obj"\nhigh-file = "high.obj"\noutput = "out/map.png"\n')
    sent = []
    monkeypatch.setattr(flamenco, "submit", lambda _url, job: sent.append(job.settings))
    checkout, options = '"/a b/python" "/c d/imprint.py" bake', '--size 64 --output-folder "/a b"'
    words = [
        "--flamenco",
        "farm",
        "--shards",
        "1",
        "--force",
        "--reports",
        "/out",
        "--untrusted",
        "--command",
        checkout,
    ]
    assert farm_command.run([str(jobs), *words, "--options", options], "imprint") == 0
    check, bake, merge = map(words_of, compiled(**sent[0]))
    for task in (check, bake):
        assert task[:3] == ["/a b/python", "/c d/imprint.py", "bake"]
        run, rest = arguments.split_jobs(task[3:])
        assert (run.untrusted, run.output_folder, arguments.parse(rest).size) == (True, "/a b", (64, 64))
    check_shard(bake[3:], 1, 1, jobs=str(jobs), reports="/out", is_forced=True, size=(64, 64))
    check_merge(merge[3:], 1, "/out")


# OpenJD


def run_step(name, **values):
    """Run the script of a step of the template in a shell, as openjd-cli does."""
    text = (FARM / "openjd" / "template.yaml").read_text(encoding="utf-8")
    step = re.search(rf"^  - name: {name}\n((?:    .*\n|\n)+)", text, re.MULTILINE)[1]
    for key, value in values.items():
        step = step.replace("{{" + key + "}}", value)
    args = json.loads(re.search(r"^ +args: (.+)$", step, re.MULTILINE)[1])
    script = step.split("data: |\n", maxsplit=1)[1]
    assert args[0] == "{{Task.File.Run}}"
    assert "{{" not in script + "".join(args[1:])
    subprocess.run(["bash", "-c", script, "bash", *args[1:]], check=True)


def test_openjd_checks_then_bakes_then_merges(noted):
    program, calls = noted
    given = {"Param.Command": program, "Param.Folder": "/a folder", "Param.Jobs": "jobs.toml", "Param.Shards": "2"}
    run_step("Check", **given, **{"Param.Options": "--size 64"})
    for done in ("--resume", "--force"):
        run_step("Bake", **given, **{"Task.Param.Shard": "2", "Param.Done": done, "Param.Options": "--size 64"})
    run_step("Merge", **given)
    check, again, forced, merge = calls()
    check_first(check, size=(64, 64))
    check_shard(again, 2, 2, reports="/a folder/reports", size=(64, 64))
    check_shard(forced, 2, 2, reports="/a folder/reports", is_forced=True, size=(64, 64))
    check_merge(merge, 2, "/a folder/reports")


# Slurm


@pytest.fixture
def slurm(noted, tmp_path, monkeypatch):
    """The environment of a task of an array, with programs that stand for Slurm's; and the calls, as `noted` has them."""
    program, calls = noted
    own = tmp_path / "slurm"
    add_program(own, monkeypatch, "srun", '#!/bin/bash\nwhile [[ $1 == --* ]]; do shift; done\nexec "$@"\n')
    for name in ("scontrol", "sbatch"):
        add_program(own, monkeypatch, name, f'#!/bin/bash\nCODE=0 {program} {name} "$@"\necho 7\n')
    values = {"SLURM_ARRAY_JOB_ID": "7", "SLURM_ARRAY_TASK_ID": "2", "SLURM_ARRAY_TASK_COUNT": "3"}
    for name, value in {**values, "IMPRINT_COMMAND": program}.items():
        monkeypatch.setenv(name, value)
    return calls


def run_slurm(script, *words):
    """Run a script of Slurm's. Returns its exit code."""
    return subprocess.call(["bash", str(FARM / "slurm" / script), *words], stdout=subprocess.DEVNULL)


def test_slurm_bakes_a_part(slurm, monkeypatch):
    assert run_slurm("bake_array.sh", JOBS, "--size", "64") == 0
    monkeypatch.setenv("SHARDS", "16")
    assert run_slurm("bake_array.sh", JOBS) == 0
    of_three, of_sixteen = slurm()
    check_shard(of_three, 2, 3, size=(64, 64))
    check_shard(of_sixteen, 2, 16)


@pytest.mark.parametrize("code", [exit_codes.FAILED, exit_codes.WRONG_USAGE, exit_codes.NO_MACHINE, exit_codes.GATE])
def test_slurm_requeues_where_another_machine_may_help(slurm, monkeypatch, code):
    monkeypatch.setenv("CODE", str(code))
    assert run_slurm("bake_array.sh", JOBS) == code
    requeued = [["scontrol", "requeue", "7_2"]] if code == exit_codes.NO_MACHINE else []
    assert slurm()[1:] == requeued


def test_slurm_gives_up_after_three_machines(slurm, monkeypatch):
    monkeypatch.setenv("CODE", str(exit_codes.NO_MACHINE))
    monkeypatch.setenv("SLURM_RESTART_COUNT", "3")
    assert run_slurm("bake_array.sh", JOBS) == exit_codes.NO_MACHINE
    assert len(slurm()) == 1


def test_slurm_merges_after_the_array(slurm, tmp_path, monkeypatch):
    jobs = tmp_path / "jobs.toml"
    jobs.touch()
    assert run_slurm("submit.sh", str(jobs), "4", "--size", "64") == 0
    array, merge = slurm()
    assert array[:3] == ["sbatch", "--parsable", "--array=1-4"]
    assert array[4:] == [str(jobs), "--size", "64"]
    assert merge[2] == "--dependency=afterany:7"
    monkeypatch.setenv("SHARDS", "4")
    assert run_slurm(os.path.basename(merge[3]), JOBS) == 0
    check_merge(slurm()[-1], 4)


# Containers and Kubernetes


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
    manifest_values = dict(re.findall(r'{name: (\w+), value: "?([^"}]+)"?}', MANIFEST))
    (args,) = re.findall(r"^ +args: \[(.+)\]", MANIFEST, re.MULTILINE)
    for key, value in {**manifest_values, name: "4"}.items():
        monkeypatch.setenv(key, value)
    words = run_entry(noted, tmp_path, monkeypatch, *args.split(", "))
    check_shard(words, 5, int(manifest_values["SHARDS"]), jobs="/data/jobs.toml", reports="/data/jobs-reports")


def test_kubernetes_has_as_many_parts_as_pods():
    (shards,) = re.findall(r'name: SHARDS, value: "(\d+)"', MANIFEST)
    assert re.findall(r"^  completions: (\d+)", MANIFEST, re.MULTILINE) == [shards]


def test_kubernetes_decides_by_exit_codes():
    found = re.findall(r"action: (\w+)\n +onExitCodes: .* values: \[([\d, ]+)\]", MANIFEST)
    actions = sorted((int(code), action) for action, codes in found for code in codes.split(","))
    assert actions == [
        (exit_codes.FAILED, "Count"),
        (exit_codes.WRONG_USAGE, "FailJob"),
        (exit_codes.NO_MACHINE, "Count"),
        (exit_codes.GATE, "FailIndex"),
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
