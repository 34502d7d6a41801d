# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of what programs read while bakes go on (--progress json), and of calls that print errors alone (--quiet)."""

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from addon.cli import run_report, terminal
from addon.cli.run_report import State
from addon.core.progress import Progress
from scripts.imprint import ROOT
from tests.support import lanes, scenes
from tests.support.manual import names, rows, section

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")

SABOTAGE = ROOT / "tests" / "support" / "sabotage"
LAUNCHED = ("scripts/imprint.py", "bake")
PAGE = ROOT / "docs" / "farms.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with good_low.obj and good_high.obj."""
    monkeypatch.chdir(tmp_path)
    scenes.plane_files(tmp_path, good_low=0.0, good_high=0.2)
    return tmp_path


def jobs(folder, *names, **values):
    """A job file with a bake for each name, which is in its low mesh's file."""
    sets = []
    for name in names:
        (folder / f"{name}_low.obj").write_bytes((folder / "good_low.obj").read_bytes())
        sets.append({"low-file": f"{name}_low.obj", "high-file": "good_high.obj", "output": f"{name}.png", **values})
    (folder / "j.json").write_text(json.dumps({"defaults": {"size": 16, "limit": 9}, "bake": sets}))
    return ["--jobs", "j.json"]


def run(*words, script=("scripts/bake.py",)):
    """The exit code, standard output and standard error of a call whose bakes fail as their names say."""
    program = [sys.executable, str(ROOT / script[0]), *script[1:]]
    variables = dict(os.environ, PYTHONPATH=str(SABOTAGE))
    done = subprocess.run([*program, *words], capture_output=True, text=True, env=variables, check=False)
    return done.returncode, done.stdout, done.stderr


def checked(err):
    """The events in standard error, which holds nothing else, with the keys in the manual."""
    found = [json.loads(line) for line in err.splitlines()]
    documented = {
        name: set(names(cells[1])) for cells in rows(section(PAGE, "## Progress")) for name in names(cells[0])
    }
    for each in found:
        assert set(each) - {"event"} == documented[each["event"]], each
    return found


def of(found, event):
    return [each for each in found if each["event"] == event]


@pytest.mark.parametrize("count", lanes.slow_but(["0"], ["0", "1", "3"]))
def test_each_bake_starts_and_ends(folder, count):
    words = [*jobs(folder, "a", "b", "c"), "--workers", count, "--progress", "json"]
    code, out, err = run(*words)
    found = checked(err)
    assert code == run_report.DONE
    assert found[0] == {"event": "planned", "planned": 3, "chosen": 3, "shard": None}
    assert found[-1]["event"] == "finished"
    assert (found[-1]["exit_code"], found[-1]["done"]) == (0, 3)
    bakes = [(number, f"set {number} ({name}_low)") for number, name in enumerate("abc", 1)]
    assert sorted((each["number"], each["name"]) for each in of(found, "started")) == bakes
    assert sorted((each["number"], each["name"]) for each in of(found, "done")) == bakes
    for number, name in enumerate("abc", 1):
        own = [each for each in found if each.get("number") == number]
        assert own[0]["event"] == "started"
        assert own[-1]["event"] == "done"
        assert {each["event"] for each in own[1:-1]} <= {"percent"}  # short bakes may have none
        assert all(0.0 <= each["percent"] <= 100.0 and each["what"] for each in own[1:-1])
        assert own[-1]["files"] == [str(folder / f"{name}.png")]
    assert of(found, "percent")
    assert "3 done" in out


@pytest.mark.slow
def test_crashes_and_failures_are_events_and_messages(folder):
    words = [*jobs(folder, "a", "crash", "b", "leave"), "--workers", "3", "--progress=json", "--strict", "coverage<1%"]
    code, _, err = run(*words)
    found = checked(err)
    assert code == run_report.FAILED
    ends = {each["number"]: each for each in found if each["event"] in set(State)}
    assert [(number, each["event"]) for number, each in sorted(ends.items())] == [
        (1, "gate"),
        (2, "failed"),
        (3, "gate"),
        (4, "failed"),
    ]
    assert (ends[2]["cause"], ends[2]["signal"]) == ("crash", "SIGSEGV")
    assert ends[4]["error"] == "Blender crashed with exit code 7."
    assert ends[1]["gate"] == ["coverage is 100 %, and must be less than 1 %."]
    assert any(each["text"].endswith(ends[2]["error"]) for each in of(found, "message"))
    assert {each["severity"] for each in of(found, "message")} == {"error"}
    assert {key: found[-1][key] for key in ("exit_code", "failed", "gate", "done")} == {
        "exit_code": 1,
        "failed": 2,
        "gate": 2,
        "done": 0,
    }


@pytest.mark.slow
def test_bakes_that_were_done_before_are_events(folder):
    words = [*jobs(folder, "a", "b"), "--resume", "--progress", "json"]
    run(*words)
    found = checked(run(*words)[2])
    assert Counter(each["event"] for each in found) == {"planned": 1, "resumed": 2, "finished": 1}


@pytest.mark.slow
def test_a_single_bake_has_events_too(folder):
    words = ["--low-file", "good_low.obj", "--high-file", "good_high.obj", "--output", "a.png", "--size", "16"]
    words += ["--limit", "0.01"]
    code, out, err = run(*words, "--progress", "json", "--report", "-")
    found = checked(err)
    assert code == run_report.DONE
    assert [each["name"] for each in (*of(found, "started"), *of(found, "done"))] == ["good_low", "good_low"]
    severities = {each["text"]: each["severity"] for each in of(found, "message")}
    assert all(("warning: " in text) == (severity == "warning") for text, severity in severities.items())
    assert set(severities.values()) == {"warning", "info"}  # the high mesh is beyond the limit; the summary
    assert json.loads(out)["bakes"][0]["state"] == "done"


def test_wrong_calls_are_events(folder):
    for words in (["--nothing"], ["--jobs", "missing.json"], jobs(folder, "a", maps="nothing")):
        code, out, err = run(*words, "--progress", "json")
        found = checked(err)
        assert (code, out) == (run_report.WRONG_USAGE, "")
        assert [(each["event"], each.get("severity")) for each in found] == [("message", "error"), ("finished", None)]
        assert found[-1]["exit_code"] == run_report.WRONG_USAGE


@pytest.mark.slow
def test_the_launcher_writes_events_of_a_crash(folder):
    words = ["--low-file", "good_low.obj", "--high-file", "good_high.obj", "--output", "a.png", "--size", "4096"]
    program = [sys.executable, str(ROOT / LAUNCHED[0]), *LAUNCHED[1:], *words, "--samples", "64", "--progress", "json"]
    process = subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    first = next(process.stderr)  # the bake has begun
    (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="utf-8").split()
    os.kill(int(child), signal.SIGSEGV)
    found = checked("".join([first, *process.stderr]))
    assert process.wait() == run_report.FAILED
    assert "Blender crashed with signal 11" in found[-1]["text"]


@pytest.mark.slow
def test_a_stopped_call_has_an_end(folder):
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "scripts" / "bake.py"), *jobs(folder, *"abcdefgh"), "--progress", "json"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    first = [next(process.stderr), next(process.stderr)]
    process.send_signal(signal.SIGTERM)
    found = checked("".join([*first, *process.stderr]))
    assert process.wait() == found[-1]["exit_code"] == 128 + signal.SIGTERM


def test_percentages_come_a_few_times_a_second(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    shown = terminal.Events(sys.stderr)
    shown.begin(terminal.Plan("a", None))
    for number in range(1000):
        now[0] = number * 0.001
        shown.show("a", Progress("Drawing", number / 1000))
    found = of(checked(capsys.readouterr().err), "percent")
    assert len(found) == 4
    assert found[2]["percent"] == 50.0


@pytest.mark.slow
def test_a_quiet_call_prints_errors_alone(folder):
    words = [*jobs(folder, "a", "b"), "--quiet"]
    assert run(*words) == (run_report.DONE, "", "")
    single = ["--low-file", "good_low.obj", "--high-file", "good_high.obj", "--output", "a.png", "--size", "16"]
    assert run(*single, "--quiet", script=LAUNCHED) == (run_report.DONE, "", "")
    code, out, err = run(*words, "--report", "-")
    assert (code, err) == (run_report.DONE, "")
    assert len(json.loads(out)["bakes"]) == 2
    (folder / "b_low.obj").write_text("")
    code, out, err = run(*words)
    assert (code, out) == (run_report.FAILED, "")
    assert err.startswith("imprint: set 2 (b_low): ")
    assert len(err.splitlines()) == 1
