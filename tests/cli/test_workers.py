# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of bakes in processes of their own: one that crashes, hangs or takes too much memory ends alone."""

import errno
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from addon.cli import (
    arguments,
    clashes,
    command,
    interruption,
    job_file,
    plans,
    run_report,
    worker,
    worker_pool,
    worker_process,
)
from addon.cli.options import RunOptions
from addon.cli.run_report import Entry
from addon.cli.terminal import Meter
from addon.cli.work_queue import WorkQueue
from addon.cli.worker_process import Answer, FilesFound, Percent, Ready
from addon.core.errors import BakeError, NoGpu
from addon.core.progress import Progress
from addon.jobs import job
from scripts.imprint import ROOT
from tests.support import reports, zoo

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")

CRASH = re.compile(
    r"Blender crashed with signal 11, Segmentation fault, in string_at, line \d+ of ctypes/__init__.py, after it printed "
    r"'crashes'\."
)
SABOTAGE = ROOT / "tests" / "support" / "sabotage"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with good_low.obj and good_high.obj."""
    monkeypatch.chdir(tmp_path)
    for name, slope in (("good_low", 0.0), ("good_high", 0.2)):
        zoo.plane(name, slope=slope)
        bpy.ops.wm.obj_export(filepath=str(tmp_path / f"{name}.obj"), export_selected_objects=False)
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return tmp_path


def jobs(folder, *names):
    """A job file with a bake for each name, whose low mesh's file has it."""
    sets = []
    for name in names:
        (folder / f"{name}_low.obj").write_bytes((folder / "good_low.obj").read_bytes())
        sets.append({"low-file": f"{name}_low.obj", "high-file": "good_high.obj", "output": f"{name}.png"})
    (folder / "j.json").write_text(json.dumps({"defaults": {"size": 16, "limit": 9}, "bake": sets}))
    return ["--jobs", "j.json", "--report", "r.json"]


def start(*words):
    """scripts/bake.py with bakes that fail as their names say."""
    return subprocess.Popen(
        [sys.executable, str(ROOT / "scripts" / "bake.py"), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ, PYTHONPATH=str(SABOTAGE)),
    )


def run(*words):
    """The exit code, standard output and standard error of `start`."""
    process = start(*words)
    try:
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    return process.returncode, out, err


def outcome(folder):
    return [(each["name"], each["state"], each["cause"], each["signal"]) for each in reports.bakes(folder / "r.json")]


def test_a_crash_ends_one_bake_alone(folder):
    code, out, err = run(*jobs(folder, "a", "crash", "b", "leave", "c"))
    assert code == run_report.FAILED
    assert outcome(folder) == [
        ("set 1 (a_low)", "done", "", ""),
        ("set 2 (crash_low)", "failed", "crash", "SIGSEGV"),
        ("set 3 (b_low)", "done", "", ""),
        ("set 4 (leave_low)", "failed", "crash", ""),
        ("set 5 (c_low)", "done", "", ""),
    ]
    crashed, left = err.splitlines()
    assert CRASH.fullmatch(crashed.removeprefix("imprint: set 2 (crash_low): "))
    assert left == "imprint: set 4 (leave_low): Blender crashed with exit code 7."
    assert [line for line in out.splitlines() if line.startswith("Saved")] == [
        f"Saved: '{folder / name}.png'" for name in "abc"
    ]
    assert "3 done, 2 failed" in out


@pytest.mark.slow
def test_the_error_of_a_crash_has_the_last_words_of_its_log(folder):
    """And not those of the worker's other bakes."""
    run(*jobs(folder, "write", "crash", "leave"), "--log", "logs")
    _, crashed, left = reports.bakes(folder / "r.json")
    assert CRASH.fullmatch(crashed["error"])
    assert left["error"] == "Blender crashed with exit code 7."


@pytest.mark.slow
def test_the_error_of_a_crash_without_a_log_has_the_last_words_of_its_bake(folder):
    run(*jobs(folder, "write", "leave"))
    assert reports.bakes(folder / "r.json")[1]["error"] == "Blender crashed with exit code 7."


@pytest.mark.slow
@pytest.mark.parametrize("more", [[], ["--log", "logs"]], ids=["no log", "log"])
def test_a_crash_while_blender_is_silenced_has_its_place(folder, more):
    """Most crashes are in importers and in the opening of files, whose messages are discarded."""
    run(*jobs(folder, "mute"), *more)
    (crashed,) = reports.bakes(folder / "r.json")
    assert re.match(r"Blender crashed with signal 11, Segmentation fault, in string_at, line \d+ of", crashed["error"])


@pytest.mark.slow
def test_a_blend_that_is_cut_off_is_a_mistake_in_the_input(folder):
    """Blender may crash at it, and the farm would try another machine."""
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "whole.blend"), compress=False)
    (folder / "cut.blend").write_bytes((folder / "whole.blend").read_bytes()[:5000])
    words = jobs(folder, "a")
    cut = {"file": "cut.blend", "low": "a", "high": "b", "output": "cut.png"}
    table = json.loads((folder / "j.json").read_text())
    (folder / "j.json").write_text(json.dumps({**table, "bake": [*table["bake"], cut]}))
    run(*words)
    assert outcome(folder) == [("set 1 (a_low)", "done", "", ""), ("set 2 (a)", "failed", "input", "")]
    assert (
        reports.bakes(folder / "r.json")[1]["error"] == f"{str(folder / 'cut.blend')!r} is not a complete .blend file."
    )


def test_a_bake_that_hangs_is_ended_at_the_limit(folder):
    code, _, err = run(*jobs(folder, "hang", "a"), "--timeout", "5", "--log", "logs")
    assert code == run_report.FAILED
    assert outcome(folder) == [("set 1 (hang_low)", "failed", "timeout", ""), ("set 2 (a_low)", "done", "", "")]
    assert "It took more than 5 s, the limit." in err
    hung, done = (each["log"] for each in reports.bakes(folder / "r.json"))
    assert hung == str(folder / "logs" / "000001_set_1_hang_low.log")
    assert Path(hung).read_text().splitlines()[-1] == "hangs"
    assert Path(done).is_file()


@pytest.mark.slow
def test_a_message_that_comes_byte_by_byte_delays_no_limit(folder):
    """The next bake goes on in another worker."""
    code, _, err = run(*jobs(folder, "drip", "a"), "--timeout", "4")
    assert code == run_report.FAILED
    assert outcome(folder) == [("set 1 (drip_low)", "failed", "timeout", ""), ("set 2 (a_low)", "done", "", "")]
    assert "It took more than 4 s, the limit." in err
    assert reports.bakes(folder / "r.json")[0]["seconds"] < 6.0


@pytest.mark.slow
def test_a_worker_that_sends_no_messages_ends_one_bake_alone(folder):
    run(*jobs(folder, "garble", "a"))
    assert [(each["cause"], each["error"]) for each in reports.bakes(folder / "r.json")] == [
        ("crash", "Its process sent what is not a message."),
        ("", ""),
    ]


@pytest.mark.slow
def test_a_bake_that_takes_too_much_memory_is_ended_at_the_limit(folder):
    code, _, err = run(*jobs(folder, "fill", "a"), "--max-memory", "1G")
    assert code == run_report.NO_MACHINE
    assert outcome(folder) == [("set 1 (fill_low)", "failed", "memory", ""), ("set 2 (a_low)", "done", "", "")]
    assert "more than the limit of 1,024 MiB." in err


@pytest.mark.slow
def test_a_worker_that_another_process_kills_has_crashed(folder):
    code, _, _ = run(*jobs(folder, "killed"))
    assert code == run_report.FAILED
    assert outcome(folder) == [("killed_low", "failed", "crash", "SIGKILL")]


@pytest.mark.slow
def test_several_workers_make_the_same_files_and_one_report_in_their_order(folder):
    words = jobs(folder, *"abcdef")
    assert run(*words, "--workers", "0")[0] == run_report.DONE
    expected = {path.name: path.read_bytes() for path in folder.glob("?.png")}
    here = reports.bakes(folder / "r.json")
    for count in ("1", "3"):
        for path in folder.glob("?.png"):
            path.unlink()
        assert run(*words, "--workers", count)[0] == run_report.DONE
        assert {path.name: path.read_bytes() for path in folder.glob("?.png")} == expected
        found = reports.bakes(folder / "r.json")
        assert [each["name"] for each in found] == [each["name"] for each in here]
        assert [each["files"] for each in found] == [each["files"] for each in here]


@pytest.mark.slow
def test_the_next_bake_begins_before_the_result_of_the_last_one_is_used(folder):
    jobs(folder, *"abcd")
    planned, _ = plans.plans_of(job_file.read("j.json"))
    files, turns = clashes.RunFiles(), WorkQueue(planned)
    assert files.add([(plan.name, plan.options) for plan in planned], "j.json", None, []) == []
    with Meter(io.StringIO()) as meter, worker_pool.WorkerPool(RunOptions()) as started:
        results = started.bake_all(turns, files, meter)
        assert [(done.state, turns.count) for done in results] == [("done", left) for left in (2, 1, 0, 0)]


@pytest.mark.parametrize(
    ("busy_for", "is_ready", "has_lost", "left", "expected"),
    [
        (4.0, True, False, 1, 1),
        (6.0, True, False, 1, 2),  # more than half of the limit
        (6.0, True, False, 0, 1),
        (0.0, True, True, 1, 2),
        (0.0, False, True, 1, 1),
        (None, True, True, 1, 1),
    ],
)
def test_a_spare_worker_starts_when_another_may_end(monkeypatch, *, busy_for, is_ready, has_lost, left, expected):
    """busy_for: seconds that the only worker has its bake; None if it has none."""
    monkeypatch.setattr(worker_pool, "Worker", lambda *_: made(plan=None, is_ready=False))
    watching = worker_pool.WorkerPool(RunOptions(timeout=10.0))
    watching._has_crashed = has_lost
    plan = None if busy_for is None else object()
    watching._workers.append(made(plan=plan, is_ready=is_ready, begun=time.monotonic() - (busy_for or 0.0)))
    for _ in range(2):
        watching._fill(left)
        assert len(watching._workers) == expected


def made(*, plan, is_ready, begun=0.0):
    """Stands for a worker."""
    return SimpleNamespace(plan=plan, begun=begun, is_well=is_ready, is_ready=is_ready, close=lambda: None)


def dying(made_):
    """A function that stands for Worker: what it starts ends before Blender starts, and is appended to `made_`."""

    def make(*_):
        worker_ = made(plan=None, is_ready=False)
        worker_.end = lambda: worker_process.Ending("exit code 9", "", lacked_memory=False)
        worker_.last_printed, worker_.crash_output = str, str
        made_.append(worker_)
        return worker_

    return make


def failing(made_):
    """A function that stands for Worker and cannot start one."""

    def make(*_):
        made_.append(None)
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    return make


@pytest.mark.parametrize("start_", [dying, failing])
@pytest.mark.parametrize(("count", "expected"), [(1, 1), (2, 3)])
def test_workers_that_do_not_start_end_no_run_while_another_is_well(monkeypatch, start_, count, expected):
    """A spare one is tried once, others three times, and again once the other has ended."""
    made_ = []
    monkeypatch.setattr(worker_pool, "Worker", start_(made_))
    watching = worker_pool.WorkerPool(RunOptions(workers=count))
    watching._has_crashed = True
    well = made(plan=object(), is_ready=True)
    watching._workers.append(well)

    def fill():
        watching._fill(9)
        for worker_ in watching._workers[1:]:
            assert list(watching._handle_exit(worker_)) == []

    for _ in range(9):
        fill()
        assert watching._workers == [well]
    assert len(made_) == expected
    watching._remove(well)
    watching._workers.append(made(plan=object(), is_ready=True))
    fill()
    assert len(made_) > expected


def test_without_another_worker_the_third_that_ends_unready_ends_the_run(monkeypatch):
    """Those that ended while another was well do not count."""
    monkeypatch.setattr(worker_pool, "Worker", dying([]))
    watching = worker_pool.WorkerPool(RunOptions(workers=2))
    well = made(plan=object(), is_ready=True)
    watching._workers.append(well)
    for _ in range(2):
        watching._fill(9)
        assert list(watching._handle_exit(watching._workers[-1])) == []
    watching._remove(well)
    for _ in range(2):
        watching._fill(1)
        assert list(watching._handle_exit(watching._workers[-1])) == []
    watching._fill(1)
    with pytest.raises(NoGpu, match=r"^Blender does not start here: exit code 9\.$"):
        list(watching._handle_exit(watching._workers[-1]))


def test_a_worker_that_ends_unready_ends_the_run_after_others_could_not_be_started(monkeypatch):
    made_ = []
    first = dying(made_)(None)
    monkeypatch.setattr(worker_pool, "Worker", failing(made_))
    watching = worker_pool.WorkerPool(RunOptions(workers=2))
    watching._workers.append(first)
    watching._fill(9)
    assert len(made_) == 1 + worker_pool.MOST_STARTS
    with pytest.raises(NoGpu):
        list(watching._handle_exit(first))


def test_workers_that_end_between_their_start_and_their_first_bake_are_not_started_for_ever(monkeypatch):
    """As where other machines have all bakes that are left."""
    made_ = []
    monkeypatch.setattr(worker_pool, "Worker", dying(made_))
    watching = worker_pool.WorkerPool(RunOptions())

    def fill():
        watching._fill(1)
        made_[-1].is_ready = True
        return list(watching._handle_exit(made_[-1]))

    for _ in range(worker_pool.MOST_STARTS - 1):
        assert fill() == []
    with pytest.raises(NoGpu, match=r"^Blender ends here before it bakes: exit code 9\.$"):
        fill()
    assert len(made_) == worker_pool.MOST_STARTS


def test_a_first_worker_that_cannot_be_started_leaves_nothing_behind(monkeypatch):
    monkeypatch.setattr(worker_pool, "Worker", failing([]))
    before = list(interruption._at_end)
    with pytest.raises(BakeError, match="A process to bake in could not be started: Resource temporarily"):
        worker_pool.WorkerPool(RunOptions()).__enter__()
    assert interruption._at_end == before


@pytest.mark.slow
@pytest.mark.parametrize(("name", "expected"), [("good", 1), ("crash", 3)])
def test_after_a_crash_there_is_a_spare_worker(folder, monkeypatch, name, expected):
    monkeypatch.setenv("PYTHONPATH", str(SABOTAGE))
    made_, make = [], worker_pool.Worker
    monkeypatch.setattr(worker_pool, "Worker", lambda *more: made_.append(make(*more)) or made_[-1])
    command.run(jobs(folder, name, "a", "b", "c"), may_start_processes=True)
    assert len(made_) == expected


def test_a_spare_worker_bakes_when_another_has_ended():
    watching = worker_pool.WorkerPool(RunOptions())
    first, spare = (made(plan=object(), is_ready=True), made(plan=None, is_ready=True))
    watching._workers += [first, spare]
    assert watching._free() == []
    first.plan = None
    assert watching._free() == [first]
    watching._workers.remove(first)
    assert watching._free() == [spare]


def test_messages_about_progress_are_few():
    sent = []

    class Parent:
        send = sent.append

    meter = worker._Meter(Parent(), is_on=True)
    for number in range(1000):
        meter.show("a", Progress("Rays", number / 1000))
    assert sent == [Percent("a", "Rays", 0.0)]


@pytest.mark.parametrize(
    ("words", "used", "is_asked"),
    [
        (["--low-file", "a.obj", "--output", "m.png"], [], False),
        (["--low-file", "a.obj", "--output", "m.png"], [("t.png", "a texture of the meshes")], True),
        (["s.blend", "--low", "lo", "--output", "m.png"], [], False),
        (["s.blend", "--pairs", "--output", "{low}.png"], [], True),
    ],
)
def test_a_worker_asks_about_files_that_only_it_has_found(words, used, is_asked):
    asked = []

    class Parent:
        send, receive = asked.append, Answer

    worker._Files(Parent()).opened("a", arguments.parse(words, "imprint"), ["lo"], iter(used))
    assert asked == [FilesFound(["lo"], used)] * is_asked


def scene(folder, count):
    """A .blend with planes, and the sets that bake each, of which the last one saves the scene."""
    for number in range(count):
        zoo.plane(f"low{number}")
        zoo.plane(f"high{number}", slope=0.1 * number)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "s.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    sets = [
        {"file": "s.blend", "low": f"low{number}", "high": f"high{number}", "output": f"{number}.png"}
        for number in range(count)
    ]
    sets[-1]["save-blend"] = "saved.blend"
    return sets


@pytest.mark.slow
def test_sets_of_a_scene_that_is_saved_stay_in_one_worker(folder):
    sets = [
        *scene(folder, 4),
        *(
            {"low-file": "good_low.obj", "high-file": "good_high.obj", "output": f"f{number}.png"}
            for number in range(4)
        ),
    ]
    (folder / "j.json").write_text(json.dumps({"defaults": {"size": 16, "limit": 9}, "bake": sets}))
    assert run("--jobs", "j.json", "--report", "r.json", "--workers", "3")[0] == run_report.DONE
    bpy.ops.wm.open_mainfile(filepath=str(folder / "saved.blend"))
    assert [bpy.data.objects[f"low{number}"].active_material is not None for number in range(4)] == [True] * 4


def hanging(folder, *more):
    """A process whose second of three bakes hangs, and its workers."""
    process = start(*jobs(folder, "a", "hang", "b"), "--log", "logs", *more)
    log = folder / "logs" / "000002_set_2_hang_low.log"
    while not (log.is_file() and "hangs" in log.read_text()):
        assert process.poll() is None
        time.sleep(0.05)
    return process, Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()


@pytest.mark.slow
def test_a_bake_that_hangs_is_ended_some_time_after_one_signal(folder):
    """The report is whole, the other bake has its record, and no claim is left."""
    process, children = hanging(folder, "--resume")
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 128 + signal.SIGTERM
    done, stopped = reports.bakes(folder / "r.json")
    assert [(each["name"], each["state"]) for each in (done, stopped)] == [
        ("set 1 (a_low)", "done"),
        ("set 2 (hang_low)", "stopped"),
    ]
    assert stopped["error"] == "It was stopped: its process was killed because it did not stop within 5 s."
    assert stopped["cause"] == ""
    assert stopped["log"].endswith("_hang_low.log")
    assert "imprint: stopped, 1 of 3 were finished." in err
    assert [path.name for path in folder.glob("*.imprint.*")] == ["a.png.imprint.json"]
    assert not [number for number in children if Path(f"/proc/{number}").exists()]


@pytest.mark.slow
def test_a_large_file_that_is_compared_delays_neither_limits_nor_signals(folder):
    """The second bake waits for its file, which the first process reads for its record."""
    process = start(*jobs(folder, "hang", "slow"), "--resume", "--timeout", "3", "--workers", "2")
    begun = time.monotonic()
    assert process.stderr.readline() == "imprint: set 1 (hang_low): It took more than 3 s, the limit.\n"
    assert time.monotonic() - begun < 20.0
    process.send_signal(signal.SIGTERM)
    begun = time.monotonic()
    process.communicate(timeout=60)
    assert time.monotonic() - begun < worker_pool.LONGEST_STOP
    assert process.returncode == 128 + signal.SIGTERM
    assert outcome(folder) == [("set 1 (hang_low)", "failed", "timeout", "")]
    assert not list(folder.glob("*.imprint.*"))


@pytest.mark.slow
def test_a_large_file_of_an_untrusted_bake_delays_no_signal(folder):
    """What its process says of it is compared."""
    (folder / "out").mkdir()
    words = jobs(folder, "slow")
    (folder / "j.json").write_text((folder / "j.json").read_text().replace('"slow.png"', '"out/m.png"'))
    process = start(*words, "--untrusted", "--progress", "json")
    while "started" not in process.stderr.readline():
        pass
    while not (folder / "out/m.png").exists():
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    begun = time.monotonic()
    process.communicate(timeout=60)
    assert time.monotonic() - begun < worker_pool.LONGEST_STOP + worker_pool.PATIENCE + 1.0
    assert [state for _, state, *_ in outcome(folder)] == ["stopped"]


@pytest.mark.slow
def test_a_message_that_comes_byte_by_byte_delays_no_signal(folder):
    process = start(*jobs(folder, "drip"), "--log", "logs")
    while not (folder / "logs").is_dir() or not list((folder / "logs").iterdir()):
        assert process.poll() is None
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGTERM)
    begun = time.monotonic()
    process.communicate(timeout=30)
    assert time.monotonic() - begun < worker_pool.LONGEST_STOP + worker_pool.PATIENCE + 1.0
    assert process.returncode == 128 + signal.SIGTERM


def test_a_signal_stops_the_worker_and_keeps_what_is_done(folder):
    process, children = hanging(folder)
    process.send_signal(signal.SIGTERM)
    time.sleep(0.5)
    process.send_signal(signal.SIGTERM)  # the bake hangs where it does not look
    assert process.wait(10) == 128 + signal.SIGTERM
    head, *lines = map(json.loads, (folder / "r.json.lines").open())
    assert head["planned"] == 3
    assert [line["name"] for line in lines] == ["set 1 (a_low)"]
    assert not [number for number in children if Path(f"/proc/{number}").exists()]


def test_a_worker_without_a_parent_ends(folder):
    process = start(*jobs(folder, *(f"a{number}" for number in range(200))))
    process.stdout.readline()
    (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    process.kill()
    process.wait()
    deadline = time.monotonic() + 30
    while Path(f"/proc/{child}").exists() and Path(f"/proc/{child}/stat").read_text().split()[2] != "Z":
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_a_worker_that_hangs_ends_with_its_parent(folder):
    process = start(*jobs(folder, "hang"), "--log", "logs")
    log = folder / "logs" / "000001_hang_low.log"
    while not (log.is_file() and "hangs" in log.read_text()):
        assert process.poll() is None
        time.sleep(0.05)
    (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    process.kill()
    process.wait()
    deadline = time.monotonic() + 10
    while Path(f"/proc/{child}").exists() and Path(f"/proc/{child}/stat").read_text().split()[2] != "Z":
        assert time.monotonic() < deadline
        time.sleep(0.1)


@pytest.mark.slow
def test_a_worker_that_dies_before_it_begins_a_bake_leaves_it_to_another(folder):
    assert run(*jobs(folder, "early", "a"))[0] == run_report.DONE
    assert (folder / "early").exists()
    assert outcome(folder) == [("set 1 (early_low)", "done", "", ""), ("set 2 (a_low)", "done", "", "")]


def test_a_folder_for_logs_that_cannot_be_written_is_refused(folder):
    assert run(*jobs(folder, "a"), "--log", "j.json") == (
        run_report.WRONG_USAGE,
        "",
        "imprint: --log: no files can be written to 'j.json': Not a directory.\n",
    )


@pytest.mark.slow
def test_a_log_that_cannot_be_written_stops_no_bake(folder):
    (folder / "logs" / "000001_set_1_write_low.log").mkdir(parents=True)
    (folder / "logs" / "000002_set_2_write2_low.log").symlink_to("/dev/full")
    code, _, err = run(*jobs(folder, "write", "write2", "a"), "--log", "logs")
    assert (code, [state for _, state, *_ in outcome(folder)]) == (run_report.DONE, ["done"] * 3)
    path = folder / "logs" / "000001_set_1_write_low.log"
    assert err == f"imprint: set 1 (write_low): warning: Its log {str(path)!r} could not be written: Is a directory.\n"


def test_a_blender_that_hangs_while_it_starts_is_given_up(folder, monkeypatch, capsys):
    sleep = [sys.executable, "-c", "import time; time.sleep(100)"]
    monkeypatch.setattr(worker_process, "command", lambda: sleep)
    monkeypatch.setattr(worker_pool, "LONGEST_START", 0.2)
    assert command.run(jobs(folder, "a", "b"), may_start_processes=True) == run_report.NO_MACHINE
    assert capsys.readouterr().err == "imprint: Blender does not start here: it did not start within 0.2 s.\n"


@pytest.mark.slow
def test_a_blender_that_does_not_start_is_one_sentence(folder, monkeypatch):
    (folder / "bpy.py").write_text("import os\nos._exit(9)\n")
    process = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "bake.py"), *jobs(folder, "a", "b")],
        capture_output=True,
        text=True,
        env=dict(os.environ, PYTHONPATH=str(folder)),
        check=False,
    )
    assert process.returncode == run_report.NO_MACHINE
    assert process.stderr == "imprint: Blender does not start here: exit code 9.\n"


def test_what_a_worker_sends_without_a_bake_is_ignored():
    """As one may that a file has taken over."""
    answered = []
    worker_ = SimpleNamespace(plan=None, is_ready=True, answer=answered.append)
    watching = worker_pool.WorkerPool(RunOptions())
    watching._workers.append(worker_)
    for message in (Entry(1, "a"), FilesFound(), Ready()):
        watching._messages.put((worker_, message))
        assert list(watching._receive(None, None)) == []
    assert answered == [None] * 3


def test_messages_of_a_worker_that_was_ended_are_ignored():
    watching = worker_pool.WorkerPool(RunOptions())
    watching._workers.append(made(plan=None, is_ready=True))
    watching._messages.put((made(plan=object(), is_ready=True), Entry(1, "a")))
    assert list(watching._receive(None, None)) == []


def test_a_worker_without_a_bake_that_ends_is_replaced(monkeypatch):
    idle = dying([])(None)
    idle.is_ready = idle.is_well = idle.has_ended = True
    watching = worker_pool.WorkerPool(RunOptions())
    watching._workers.append(idle)
    assert list(watching._check_limits()) == []
    assert watching._workers == []


@pytest.mark.parametrize(("most", "expected"), [(3, 3), (0, 9)])
def test_a_worker_is_replaced_after_the_bakes_that_it_may_do(most, expected):
    """Blender's Vulkan backend leaves mappings of memory behind each bake."""
    watching = worker_pool.WorkerPool(RunOptions())
    worker_ = dying([])(None)
    worker_.is_ready, worker_.answer, worker_.log = False, lambda _: None, ""
    watching._workers.append(worker_)
    assert list(watching._handle(worker_, Ready(most), None, None)) == []
    for number in range(1, 10):
        worker_.plan = SimpleNamespace(number=number, name="a", chain=0)
        worker_.assigned = SimpleNamespace(plan=worker_.plan)
        (entry,) = watching._handle(worker_, Entry(number, "a"), None, None)
        if not watching._workers:
            break
    assert (entry.number, len(watching._workers)) == (expected, int(not most))
    assert not watching._has_crashed


def test_a_worker_on_vulkan_may_do_some_hundred_bakes(monkeypatch):
    for backend, expected in (("VULKAN", True), ("OPENGL", False), ("METAL", False)):
        platform = SimpleNamespace(backend_type_get=lambda backend=backend: backend)
        monkeypatch.setattr(job.gpu, "platform", platform)
        assert job.uses_vulkan() == expected
    assert 35 * worker.MOST_ON_VULKAN < 65_530 / 2


class Blender:
    """Stands for the module bpy inside Blender."""

    class app:
        module, binary_path = False, "/opt/blender"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["blender", "-b", "--command", "imprint", "--jobs", "j"], ["-b", "--command", "imprint", "worker"]),
        (["blender", "-c", "imprint", "--jobs", "j"], ["-c", "imprint", "worker"]),
        (
            ["blender", "-b", "s.blend", "-P", "b.py", "--", "--jobs", "j"],
            ["-b", "s.blend", "-P", "b.py", "--", "worker"],
        ),
    ],
)
def test_inside_blender_a_worker_is_a_further_blender(monkeypatch, given, expected):
    monkeypatch.setitem(sys.modules, "bpy", Blender)
    assert worker_process.command(given) == ["/opt/blender", *expected]
