# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that signals stop the command line cleanly at any moment, and that finished bakes are kept and reported."""

import errno
import json
import os
import signal
import subprocess
import sys

import bpy
import numpy as np
import pytest

from addon.cli import command, interruption, run_report
from addon.jobs import bake_jobs
from addon.scene import importing
from scripts import imprint
from tests.support import reports, zoo

pytestmark = [
    pytest.mark.usefixtures("gpu_context"),
    pytest.mark.skipif(os.name == "nt", reason="signals of POSIX"),
]

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The working folder, with s.blend: two pairs by name."""
    monkeypatch.chdir(tmp_path)
    for name in "ab":
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high", slope=0.1)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "s.blend"))
    return tmp_path


def files(folder):
    return sorted(path.name for path in folder.iterdir())


ONE = ["s.blend", "--low", "a_low", "--high", "a_high", "--size", "16"]


@pytest.fixture
def stops_at(monkeypatch):
    """A function that raises signals at the `number`-th step of a bake with `word` in its text."""

    def arrange(word, number=1, signals=(signal.SIGINT,)):
        work, count = bake_jobs.work, iter(range(1000))

        def watched(*arguments, **options):
            result = work(*arguments, **options)
            try:
                while True:
                    step = next(result)
                    if word in step.what and next(count) == number - 1:
                        for each in signals:
                            signal.raise_signal(each)
                    yield step
            except StopIteration as end:
                return end.value
            finally:
                result.close()

        monkeypatch.setattr(bake_jobs, "work", watched)

    return arrange


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("word", ["Reading", "Storing"])
def test_a_stopped_bake_leaves_no_files_and_restores_handlers(scene, stops_at, capfd, number, word):
    stops_at(word, signals=[number])
    before = [signal.getsignal(each) for each in SIGNALS]
    assert command.run([*ONE, "--output", "m.png", "--report", "r.json"]) == 128 + number
    assert files(scene) == ["s.blend"]
    assert capfd.readouterr() == ("", "imprint: stopped, nothing was finished.\n")
    assert [signal.getsignal(each) for each in SIGNALS] == before


def test_a_signal_in_one_of_blenders_callbacks_is_not_lost(scene):
    """Blender would print an exception in a callback, and go on."""

    @bpy.app.handlers.persistent
    def handler(*_):
        signal.raise_signal(signal.SIGTERM)

    bpy.app.handlers.load_post.append(handler)
    try:
        assert command.run([*ONE, "--output", "m.png"]) == 128 + signal.SIGTERM
    finally:
        bpy.app.handlers.load_post.remove(handler)
    assert files(scene) == ["s.blend"]


def test_a_signal_while_a_file_is_imported_is_not_lost(scene, monkeypatch):
    bpy.ops.wm.obj_export(filepath=str(scene / "a_low.obj"))
    monkeypatch.setitem(importing.IMPORTERS, ".obj", ("imprint_test", "signal", {}))

    class Signal(bpy.types.Operator):
        bl_idname, bl_label = "imprint_test.signal", "Signal"
        filepath: bpy.props.StringProperty()

        def execute(self, _):
            signal.raise_signal(signal.SIGINT)
            return bpy.ops.wm.obj_import(filepath=self.filepath)

    bpy.utils.register_class(Signal)
    try:
        words = ["--low-file", "a_low.obj", "--high-file", "a_low.obj", "--output", "m.png"]
        assert command.run(words) == 128 + signal.SIGINT
    finally:
        bpy.utils.unregister_class(Signal)
    assert "m.png" not in files(scene)


def test_a_signal_after_the_bake_changes_only_the_exit_code(scene, monkeypatch):
    write = run_report.write_report

    def late(*arguments):
        signal.raise_signal(signal.SIGTERM)
        write(*arguments)

    monkeypatch.setattr(run_report, "write_report", late)
    assert command.run([*ONE, "--output", "m.png", "--report", "r.json"]) == 128 + signal.SIGTERM
    assert files(scene) == ["m.png", "r.json", "s.blend"]


def test_a_signal_after_the_only_map_changes_only_the_exit_code(scene, stops_at):
    stops_at("Storing", number=2)
    assert command.run([*ONE, "--output", "m.png", "--report", "r.json"]) == 128 + signal.SIGINT
    assert files(scene) == ["m.png", "r.json", "s.blend"]
    assert not reports.bake(scene / "r.json")["error"]


def test_finished_pairs_are_kept_and_reported(scene, stops_at, capfd):
    stops_at("Reading b_low")
    words = ["s.blend", "--pairs", "--size", "16", "--limit", "9", "--output", "{low}.png", "--report", "r.json"]
    assert command.run([*words, "--save-blend", "o.blend"]) == 128 + signal.SIGINT
    assert files(scene) == ["a_low.png", "r.json", "s.blend"]
    assert [pair["low"] for pair in reports.bake(scene / "r.json")["reports"]] == ["a_low"]
    out, err = capfd.readouterr()
    assert err == "imprint: stopped, the pairs before are kept.\n"
    assert out.endswith(f"Wrote {scene / 'a_low.png'}, {scene / 'r.json'}\n")


def test_finished_frames_are_kept_and_reported(scene, stops_at):
    stops_at("Reading", number=3)
    words = [*ONE, "--frames", "1-9", "--output", "m.#.png", "--report", "r.json"]
    assert command.run(words) == 128 + signal.SIGINT
    assert files(scene) == ["m.1.png", "m.2.png", "r.json", "s.blend"]
    outputs = [frame["output"] for frame in reports.bake(scene / "r.json")["reports"]]
    assert outputs == [[str(scene / "m.1.png")], [str(scene / "m.2.png")]]


def batch(scene, count=4):
    bake = {"file": "s.blend", "low": "a_low", "high": "a_high", "size": 16, "limit": 9}
    (scene / "j.json").write_text(json.dumps({"bake": [{**bake, "output": f"{n}.png"} for n in range(count)]}))
    return ["--jobs", "j.json", "--report", "r.json"]


def test_a_stopped_batch_reports_finished_bakes(scene, stops_at, capfd):
    stops_at("Reading", number=3)
    assert command.run(batch(scene)) == 128 + signal.SIGINT
    assert files(scene) == ["0.png", "1.png", "j.json", "r.json", "s.blend"]
    assert [each["state"] for each in reports.bakes(scene / "r.json")] == ["done", "done"]
    out, err = capfd.readouterr()
    assert err == "imprint: stopped, 2 of 4 were finished.\n"
    assert [line.split()[0] for line in out.splitlines()] == [
        "Saved:",
        "Saved:",
        "done",
        "done",
        "stopped",
        "2",
        "Wrote",
    ]
    assert "2 done, 0 failed, 2 stopped or not begun" in out


def test_too_little_memory_for_one_bake_does_not_stop_others(scene, monkeypatch, capfd):
    work, numbers = bake_jobs.work, iter(range(4))

    def heavy(*arguments, **options):
        if next(numbers) == 1:
            np.empty(2**59, np.float64)
        return work(*arguments, **options)

    monkeypatch.setattr(bake_jobs, "work", heavy)
    assert command.run(batch(scene)) == run_report.NO_MACHINE
    bakes = reports.bakes(scene / "r.json")
    assert [each["state"] for each in bakes] == ["done", "failed", "done", "done"]
    assert bakes[1]["cause"] == "memory"
    assert bakes[1]["error"].startswith("There is not enough memory (Unable to allocate 4.00 EiB")
    assert "Traceback" not in capfd.readouterr().err


def test_too_little_memory_gives_one_line(scene, monkeypatch, capfd):
    monkeypatch.setattr(bake_jobs, "work", lambda *_, **__: np.empty(2**59, np.float64))
    assert command.run([*ONE, "--output", "m.png"]) == run_report.NO_MACHINE
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("imprint: There is not enough memory (")


def test_each_entry_of_a_batch_is_on_the_disk_before_the_next_bake(scene, monkeypatch):
    """So that a crash loses nothing that is done."""
    seen, work = [], bake_jobs.work

    def watched(*arguments, **options):
        lines = scene / "r.json.lines"
        seen.append([json.loads(line)["name"] for line in [*lines.open()][1:]] if lines.exists() else [])
        return work(*arguments, **options)

    monkeypatch.setattr(bake_jobs, "work", watched)
    assert command.run(batch(scene)) == run_report.DONE
    names = [f"set {number} (a_low)" for number in (1, 2, 3, 4)]
    assert seen == [names[:count] for count in range(4)]
    assert [entry["name"] for entry in reports.bakes(scene / "r.json")] == names
    assert not (scene / "r.json.lines").exists()


def test_a_full_disk_does_not_stop_a_batch_and_is_reported(scene, monkeypatch, capfd):
    def fail(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", fail)
    assert command.run(batch(scene)) == run_report.FAILED
    assert files(scene) == ["0.png", "1.png", "2.png", "3.png", "j.json", "r.json.lines", "s.blend"]
    assert "r.json.lines' could not be written: No space left on device." in capfd.readouterr().err


ENDS = """
import signal, sys
from pathlib import Path
from addon.cli import interruption
from addon.output.atomic_file import Partial
with interruption.listening():
    partial = Partial(Path(sys.argv[1]))
    partial.temporary.write_text("half")
    for name in sys.argv[2:]:
        signal.raise_signal(signal.Signals[name])
    print(interruption.code())
    partial.discard()
"""


@pytest.mark.parametrize(
    ("signals", "code"),
    [
        (["SIGINT"], None),
        (["SIGINT", "SIGINT"], 130),
        (["SIGTERM", "SIGHUP"], 143),
        (["SIGUSR1", "SIGTERM"], None),  # the launcher passed the same signal on
        (["SIGTERM", "SIGUSR1"], None),
        (["SIGTERM", "SIGUSR1", "SIGTERM"], 143),
        (["SIGUSR1", "SIGUSR2"], 130),
    ],
)
def test_a_second_signal_ends_at_once_and_leaves_no_files(tmp_path, signals, code):
    program = [sys.executable, "-c", ENDS, str(tmp_path / "map.png"), *signals]
    done = subprocess.run(program, capture_output=True, text=True, check=False, cwd=imprint.ROOT)
    assert done.returncode == (code or 0), done.stderr
    assert bool(done.stdout) == (code is None)
    assert files(tmp_path) == []


def test_nohup_is_respected():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruption.listening():
            signal.raise_signal(signal.SIGHUP)
            assert interruption.code() == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_launcher_that_was_killed_stops_the_bake(monkeypatch):
    monkeypatch.setenv(interruption.LAUNCHER, str(os.getppid()))
    with interruption.listening():
        interruption.check()
        monkeypatch.setattr(os, "getppid", lambda: 2**30)  # the process that adopts orphans
        with pytest.raises(interruption.Stopped):
            interruption.check()
        assert interruption.code() == 128 + signal.SIGHUP
    interruption.check()


LATE = """
import runpy, signal, sys
class Stop:
    def find_spec(self, name, *_):
        if name == "bpy":
            sys.meta_path.remove(self)  # loading bpy calls this again
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Stop())
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0])
"""


def test_ctrl_c_before_blender_is_loaded(scene):
    """The signal comes as soon as the program can handle it."""
    program = [sys.executable, "-c", LATE, str(imprint.ROOT / "scripts" / "bake.py"), *ONE, "--output", "m.png"]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "imprint: stopped, nothing was finished.\n")
    assert files(scene) == ["s.blend"]


AFTERWARDS = """
import runpy, signal, sys
sys.argv = sys.argv[1:]
try:
    runpy.run_path(sys.argv[0])
finally:
    for _ in range(3):
        signal.raise_signal(signal.SIGINT)
"""


@pytest.mark.slow
def test_signals_after_the_end_are_ignored(scene):
    program = [sys.executable, "-c", AFTERWARDS, str(imprint.ROOT / "scripts" / "bake.py"), *ONE, "--output", "m.png"]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert (done.returncode, files(scene)) == (0, ["m.png", "s.blend"])


TWICE = """
import os, signal, sys
from pathlib import Path
from addon.cli import interruption
from addon.output.atomic_file import Partial
with interruption.listening():
    partial = Partial(Path(sys.argv[1]))
    partial.temporary.write_text("half")
    close = os.close
    def closes(number):
        close(number)
        os.close = close
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
    os.close = closes
    partial.discard()
"""


def test_a_second_signal_during_the_cleanup_ends_at_once(tmp_path):
    program = [sys.executable, "-c", TWICE, str(tmp_path / "map.png")]
    done = subprocess.run(program, capture_output=True, text=True, check=False, cwd=imprint.ROOT)
    assert (done.returncode, done.stderr) == (130, "")
    assert files(tmp_path) == []


def test_a_full_disk_for_the_name_of_the_bake_is_ignored(monkeypatch, capfd):
    full = os.open("/dev/full", os.O_WRONLY)
    monkeypatch.setenv(interruption.LAUNCHER, str(os.getppid()))
    monkeypatch.setenv(interruption.BAKING, str(full))
    with interruption.listening():
        interruption.note_bake("rock")
    os.close(full)
    assert capfd.readouterr() == ("", "")


def test_too_little_memory_for_a_job_file_gives_one_line(scene, monkeypatch, capfd):
    def read(*_):
        raise MemoryError

    monkeypatch.setattr(command, "_read", read)
    assert command.run(["--jobs", "j.json"]) == run_report.NO_MACHINE
    assert capfd.readouterr().err.startswith("imprint: There is not enough memory: ")


def test_a_process_with_another_parent_ignores_the_launcher(monkeypatch):
    """A script of a render farm may inherit the environment of the launcher."""
    monkeypatch.setenv(interruption.LAUNCHER, str(os.getpid()))
    with interruption.listening():
        interruption.check()
        assert not interruption.is_launched()


def test_only_the_name_of_the_current_bake_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv(interruption.LAUNCHER, str(os.getppid()))
    with (tmp_path / "baking").open("wb") as file, interruption.listening():
        monkeypatch.setenv(interruption.BAKING, str(file.fileno()))
        for name in ("a long name", "rock"):
            interruption.note_bake(name)
    assert (tmp_path / "baking").read_text() == "rock"
