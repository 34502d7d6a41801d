# SPDX-License-Identifier: GPL-3.0-or-later
"""The steps of the OpenJD bundle call the command line as it is."""

import json
import os
import re
import subprocess

import pytest

from tests.package.farms.farm_words import FARM, check_first, check_merge, check_shard

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for Linux and macOS")


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
    run_step("Check", **given, **{"Param.Done": "--resume", "Param.Options": "--size 64 --records /records"})
    for done in ("--resume", "--force"):
        run_step("Bake", **given, **{"Task.Param.Shard": "2", "Param.Done": done, "Param.Options": "--size 64"})
    run_step("Merge", **given)
    check, again, forced, merge = calls()
    check_first(check, size=(64, 64))
    check_shard(again, 2, 2, reports="/a folder/reports", size=(64, 64))
    check_shard(forced, 2, 2, reports="/a folder/reports", is_forced=True, size=(64, 64))
    check_merge(merge, 2, "/a folder/reports")
