# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the command gpu: its exit codes, its text, JSON and row, and the launcher."""

import json
import subprocess
import sys
from dataclasses import replace

import pytest

from addon.cli import command
from addon.core.errors import NoGpu
from addon.core.gpu_report import GpuReport, Outcome, Timed, Verdict
from addon.jobs import gpu_test
from scripts.imprint import ROOT

pytestmark = pytest.mark.usefixtures("gpu_context")

MINUTE = 60.0
"""Seconds that the test may take, also where a program draws on two cores."""
MACHINE = dict.fromkeys(
    ("system", "blender", "imprint", "backend", "vendor", "renderer", "driver", "kind", "reads"), "it"
)
RIGHT = GpuReport(
    MACHINE,
    {"texture size": 16384},
    [Outcome("Read-backs wait", Verdict.RIGHT)],
    [Outcome("Cast: normal", Verdict.EQUAL, "", 0, 4, 0.0, "degrees")],
    [Timed("Own hits", 5.0, "M rays/s")],
    1.0,
)
WRONG = replace(RIGHT, driver_checks=[Outcome("Blending", Verdict.WRONG, "Nothing is added.")])


@pytest.fixture
def found(monkeypatch):
    """Makes the test find a report, or raise an error, at once."""

    def set_result(result):
        def test(on_progress):
            if isinstance(result, Exception):
                raise result
            return result

        monkeypatch.setattr(gpu_test, "test", test)

    return set_result


def test_a_right_gpu(found, capfd):
    found(RIGHT)
    assert command.run(["gpu"]) == 0
    out, err = capfd.readouterr()
    assert out == RIGHT.text + "\n"
    assert err == ""


def test_a_wrong_gpu_ends_with_4(found, capfd, tmp_path):
    found(WRONG)
    path = tmp_path / "gpu.json"
    assert command.run(["gpu", "--report", str(path)]) == 4
    out, err = capfd.readouterr()
    assert out.startswith("1 of 2 tests are wrong")
    assert err == "imprint gpu: Blending: Nothing is added.\n"
    assert json.loads(path.read_text()) == WRONG.to_dict()


def test_no_gpu_ends_with_3_and_a_sentence(found, capfd):
    found(NoGpu("Blender has no GPU to draw on here: it is away."))
    assert command.run(["gpu"]) == 3
    assert capfd.readouterr() == ("", "imprint gpu: Blender has no GPU to draw on here: it is away.\n")


def test_the_report_can_go_to_standard_output(found, capfd):
    found(RIGHT)
    assert command.run(["gpu", "--report", "-"]) == 0
    assert json.loads(capfd.readouterr().out) == RIGHT.to_dict()


def test_the_row_of_the_manual(found, capfd):
    found(RIGHT)
    assert command.run(["gpu", "--row"]) == 0
    assert capfd.readouterr().out == RIGHT.row + "\n"


@pytest.mark.parametrize("words", [["--what"], ["more"]])
def test_wrong_arguments_are_refused(words, capfd):
    assert command.run(["gpu", *words]) == 2
    assert words[0] in capfd.readouterr().err


def test_a_file_of_another_kind_is_not_replaced(found, capfd, tmp_path):
    found(RIGHT)
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    assert command.run(["gpu", "--report", str(path)]) == 2
    assert path.read_text() == "mine"
    assert "notes.txt" in capfd.readouterr().err


@pytest.mark.slow
def test_the_launcher_runs_it(tmp_path):
    path = tmp_path / "gpu.json"
    words = [sys.executable, str(ROOT / "scripts" / "imprint.py"), "gpu", "--report", str(path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("All right: ")
    report = json.loads(path.read_text())
    assert report["is_right"]
    assert report["seconds"] < MINUTE
