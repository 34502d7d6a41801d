# SPDX-License-Identifier: GPL-3.0-or-later
"""The scripts for Slurm call the command line as it is. Programs that note their words stand for Slurm's."""

import os
import subprocess

import pytest

from addon.cli import run_report
from tests.package.farms.farm_words import FARM, JOBS, add_program, check_merge, check_shard

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for Linux and macOS")


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
    assert run_slurm("bake_array.sh", JOBS, "--force") == 0
    of_three, of_sixteen = slurm()
    check_shard(of_three, 2, 3, size=(64, 64))
    check_shard(of_sixteen, 2, 16, is_forced=True)


@pytest.mark.parametrize("code", [run_report.FAILED, run_report.WRONG_USAGE, run_report.NO_MACHINE, run_report.GATE])
def test_slurm_requeues_where_another_machine_may_help(slurm, monkeypatch, code):
    monkeypatch.setenv("CODE", str(code))
    assert run_slurm("bake_array.sh", JOBS) == code
    requeued = [["scontrol", "requeue", "7_2"]] if code == run_report.NO_MACHINE else []
    assert slurm()[1:] == requeued


def test_slurm_gives_up_after_three_machines(slurm, monkeypatch):
    monkeypatch.setenv("CODE", str(run_report.NO_MACHINE))
    monkeypatch.setenv("SLURM_RESTART_COUNT", "3")
    assert run_slurm("bake_array.sh", JOBS) == run_report.NO_MACHINE
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
