# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests links, pipes and devices in the place of files, as Windows does not have them."""

import json
import os
import re
import subprocess
import sys
import time

import pytest

from addon.cli import arguments, command, job_file
from addon.cli.arguments import WrongUsage
from addon.cli.claims import Claims
from addon.cli.records import Contents
from addon.cli.run_report import FAILED, State
from addon.core import processes
from scripts.imprint import ROOT
from tests.pure import test_job_file as files
from tests.pure import test_plan_listing as lists
from tests.pure import test_resuming as records

pytestmark = pytest.mark.skipif(os.name == "nt", reason="links, pipes and signals of POSIX")


folder, here, untrusted, version = records.folder, lists.here, records.untrusted, records.version


@pytest.mark.parametrize("key", ["inputs", "files"])
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_what_a_record_names_is_not_read_if_it_is_no_file(folder, untrusted, monkeypatch, key, kind):
    records.run([records.plan(folder)], **untrusted)
    place = folder / ("in" if key == "inputs" else "out") / "more"
    (folder / "outside").write_text("secret")
    if kind == "link":
        place.symlink_to(folder / "outside")
    else:
        os.mkfifo(place)
    records.changed(untrusted, key, place, **({"bytes": 0} if kind == "pipe" else {}))
    assert not records.read_of(folder, untrusted, monkeypatch, "more", "outside")


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_map_of_a_process_that_lies_is_neither_a_link_nor_a_pipe(folder, untrusted, monkeypatch, kind):
    make = os.mkfifo if kind == "pipe" else lambda path: path.symlink_to(folder / "out/other.png")
    entry = records.lie_of_map(folder, untrusted, monkeypatch, make)
    assert (entry.state, entry.files) == (State.FAILED, [])


def test_a_pipe_or_a_device_has_no_content(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert [Contents().of(path).size for path in (str(tmp_path / "pipe"), "/dev/zero")] == [None, None]


def test_only_plain_files_have_last_words(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("secret")
    os.symlink(secret, tmp_path / "link")
    os.mkfifo(tmp_path / "pipe")
    assert processes.crash_output_of_log(str(secret)) == ", after it printed 'secret'"
    assert [processes.crash_output_of_log(str(tmp_path / name)) for name in ("link", "pipe", "none", "")] == [""] * 4
    assert processes.crash_output_of_log(str(tmp_path)) == ""


def test_a_list_does_not_wait_for_a_pipe(capsys, here):
    os.mkfifo(here / "pipe.obj")
    code, _, (problem,) = lists.listed(capsys, [{**lists.SET, "high-file": "pipe.obj"}], "--check")
    assert (code, "There is no file" in problem) == (FAILED, True)


# Posix job paths


write = files.write


PLACES = {"HOME": "/home/me", "SHOW": "/shows/one", "SHOT": "010"}


PATHS = {
    "~/m.png": "/home/me/m.png",
    "a/~/m.png": "{here}/a/~/m.png",
    "~me.png": "{here}/~me.png",
    "$SHOW/m.png": "/shows/one/m.png",
    "${SHOW}/s$SHOT/{low}_$SHOT.png": "/shows/one/s010/{low}_010.png",
    "a$SHOT.png": "{here}/a010.png",
    "a$.png": "{here}/a$.png",
    "a:.png": "{here}/a:.png",
}


@pytest.mark.parametrize("path", PATHS)
def test_paths_in_a_job_file_have_what_a_shell_would_put_there(write, monkeypatch, path):
    for name, value in PLACES.items():
        monkeypatch.setenv(name, value)
    (found,) = job_file.read(write({"bake": [{"file": "a.blend", "low": "a", "output": path}]}, "jobs/jobs.json"))
    assert found.output == PATHS[path].replace("{here}", os.path.abspath("jobs"))


@pytest.mark.parametrize(
    ("path", "is_untrusted", "expected"),
    [
        ("$NONE/m.png", False, "'$NONE/m.png' needs the variable NONE, which is not set"),
        ("m${NONE}.png", False, "'m${NONE}.png' needs the variable NONE, which is not set"),
        ("$HOME/m.png", True, "'$HOME/m.png' has ~ or a variable, which files of other people cannot have"),
        ("~/m.png", True, "'~/m.png' has ~ or a variable, which files of other people cannot have"),
        (r"C:\maps\m.png", False, r"'C:\\maps\\m.png' is a path of Windows, and this system has other ones"),
        ("c:/maps/m.png", False, "'c:/maps/m.png' is a path of Windows, and this system has other ones"),
        (r"\\server\m.png", False, r"'\\\\server\\m.png' is a path of Windows, and this system has other ones"),
    ],
)
def test_paths_that_mean_nothing_here_are_mistakes(write, monkeypatch, path, is_untrusted, expected):
    monkeypatch.delenv("NONE", raising=False)
    content = {"bake": [{"file": "a.blend", "low": "a", "output": path}]}
    with pytest.raises(WrongUsage) as refused:
        job_file.read(write(content, "jobs/jobs.json"), is_untrusted=is_untrusted)
    assert str(refused.value).endswith(f", set 1: output: {expected}")
    if "Windows" in expected:
        with pytest.raises(WrongUsage, match=re.escape(expected)):
            arguments.parse(["a.blend", "--low", "a", "--output", path])


# Posix paths


def test_two_slashes_in_a_job_file_become_one(tmp_path):
    content = {"bake": [{"file": "//a.blend", "low": "a", "output": "//m.png"}]}
    (tmp_path / "jobs.json").write_text(json.dumps(content), encoding="utf-8")
    (found,) = job_file.read(str(tmp_path / "jobs.json"))
    assert (found.file, arguments.settings(found).storing.output) == (["/a.blend"], "/m.png")


@pytest.mark.parametrize(
    "words", [["a.blend", "--low", "a", "--output", "/m.png"], ["--jobs", "j.toml"], ["lod"], ["report"]]
)
def test_a_folder_that_was_removed_is_one_sentence(tmp_path, monkeypatch, capsys, words):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert command.run(words) == 2
    reason = "The folder in which this was started cannot be read: No such file or directory. Start it in another one."
    assert capsys.readouterr().err == f"imprint: {reason}\n"


# Posix processes


def count(path):
    return int(json.loads(path.read_bytes())["counter"])


@pytest.mark.parametrize("is_busy", [True, False])
def test_a_process_in_which_python_does_not_run_keeps_its_claims(tmp_path, is_busy):
    """As while Blender calculates tangents of millions of faces. sum() holds Python's lock as that does."""
    path, given_up = tmp_path / "a", tmp_path / "b"
    with Claims(beat=0.02, is_busy=is_busy) as held:
        assert held.take(path) and held.take(given_up)
        held.release(given_up)
        while count(path) < 3:
            time.sleep(0.01)
        before, start = count(path), time.monotonic()
        while time.monotonic() - start < 0.3:
            sum(range(30_000_000))
        assert (count(path) - before > 5) == is_busy
        assert not given_up.exists()
    assert not path.exists()


def test_claims_stay_if_the_process_that_changes_them_is_killed(tmp_path):
    with Claims(beat=0.02, is_busy=True) as held:
        assert held.take(tmp_path / "a")
        held._heartbeat._process.kill()
        held._heartbeat._process.wait()
        before = (tmp_path / "a").read_bytes()
        time.sleep(0.2)
        assert (tmp_path / "a").read_bytes() != before


def test_the_process_that_changes_claims_ends_with_its_parent(tmp_path):
    program = (
        "import os, sys, time; sys.path.insert(0, sys.argv[1]); from pathlib import Path\n"
        "from addon.cli.claims import Claims\n"
        "held = Claims(is_busy=True); held.take(Path(sys.argv[2])); print(held._heartbeat._process.pid, flush=True)\n"
        "os._exit(9)"
    )
    words = [sys.executable, "-c", program, str(ROOT), str(tmp_path / "a")]
    number = int(subprocess.run(words, capture_output=True, check=False).stdout)
    for _ in range(200):
        try:
            os.kill(number, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="affinity of Linux")
@pytest.mark.parametrize("is_old", [False, True], ids=["this Python", "Python before 3.13"])
def test_processors_are_those_that_the_process_may_use(is_old):
    program = (
        "import os, sys; sys.path.insert(0, sys.argv[1]); os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])\n"
        f"if {is_old} and hasattr(os, 'process_cpu_count'): del os.process_cpu_count\n"
        "from addon.core import threads; print(threads.processors(), threads._pool()._max_workers)"
    )
    done = subprocess.run([sys.executable, "-c", program, str(ROOT)], capture_output=True, text=True, check=True)
    assert done.stdout == "1 1\n"
