# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of bakes in processes of their own: one that crashes, hangs or takes too much memory ends alone."""

import errno
import gc
import io
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from addon.cli import (
    arguments,
    clashes,
    command,
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
from addon.cli.worker_messages import Accepted, Answer, FilesFound, Percent, Ready
from addon.core import processes
from addon.core.errors import BakeError, NoGpu
from addon.core.processes import Gone
from addon.core.progress import Progress
from addon.jobs import job
from scripts.imprint import ROOT
from tests.support import reports, scenes, zoo

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
    scenes.plane_files(tmp_path, good_low=0.0, good_high=0.2)
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


class StandIn:
    """A worker without a process.

    fate: it "bakes", at once or after it "waits", "crashes" or "hangs" in a bake, "leaves" before it, "dies" before Blender has
    started, or "ends" after a bake. sends: more messages, after it is ready. most: as in Ready.
    """

    log, memory, chain, is_stuck, bakes_left = "", 0, 0, False, -1

    def __init__(self, messages, fate, sends=(), most=0):
        self.fate, self.assigned, self.answered = fate, None, []
        self.is_ready = self.is_well = self.has_accepted = self.has_ended = self.is_closed = False
        self.started = self.assigned_at = time.monotonic()
        self._send = lambda *found: [messages.put((self, each)) for each in found]
        self._send(Gone()) if fate == "dies" else self._send(Ready(most), *sends)

    @property
    def plan(self):
        return self.assigned and self.assigned.plan

    def begin(self, _setup, assigned):
        self.assigned, self.has_accepted, self.assigned_at = assigned, False, time.monotonic()
        done = Entry(self.plan.number, self.plan.name)
        busy = [each for each in self.others if each and each.plan and not each.is_closed]
        assert len(busy) <= self.workers
        if self.fate == "leaves":
            return self._send(Gone())
        self._send(Accepted(), *{"crashes": [Gone()], "hangs": [], "waits": []}.get(self.fate, [done]))
        if self.fate == "waits":
            threading.Timer(0.2, self._send, [done]).start()
        self.has_ended = self.fate == "ends"
        return None

    def kill(self, _seconds=0.0):
        if self.plan:  # too late
            self._send(Entry(self.plan.number, self.plan.name))

    def end(self):
        return processes.Ending("exit code 9", "", lacked_memory=False)

    def answer(self, message):
        self.answered.append(message)

    def last_printed(self, *_):
        return ""

    def close(self, *_):
        self.is_closed = True

    crash_output, ask_to_stop, dismiss = last_printed, answer, last_printed


class Waiting(WorkQueue):
    """A queue whose bakes other machines have at first, for so many looks."""

    def __init__(self, planned, looks):
        super().__init__(planned)
        self.looks = looks

    def next(self, taken=()):
        self.looks -= 1
        return None if self.looks >= 0 else super().next(taken)


@pytest.fixture
def pool(monkeypatch):
    """Bakes in a pool of stand-ins. Returns the states of the bakes by their numbers; `pool.made` has the stand-ins."""
    monkeypatch.setattr(worker_pool, "LOOK_EVERY", 0.005)

    def bake(count, *fates, looks=0, **options):
        """fates: of the workers in their order, the last one for all others: a word, the arguments of StandIn, or None for one
        that cannot be started."""
        bake.made = []

        def make(messages, _sandbox):
            fate = fates[min(len(bake.made), len(fates) - 1)]
            bake.made.append(fate and StandIn(messages, *([fate] if isinstance(fate, str) else fate)))
            if fate is None:
                raise OSError(errno.EAGAIN, "Resource temporarily unavailable")
            bake.made[-1].others, bake.made[-1].workers = bake.made, options.get("workers", 1)
            return bake.made[-1]

        monkeypatch.setattr(worker_pool, "Worker", make)
        planned = [
            plans.Plan("a", SimpleNamespace(save_blend=None, export=None), number=number + 1) for number in range(count)
        ]
        with Meter(io.StringIO()) as meter, worker_pool.WorkerPool(RunOptions(**options)) as started:
            found = list(started.bake_all(Waiting(planned, looks), clashes.RunFiles(), meter))
        assert sorted(each.number for each in found) == list(range(1, count + 1))
        return {each.number: str(each.cause or each.state) for each in found}

    return bake


def states(count, **others):
    return dict.fromkeys(range(1, count + 1), "done") | {int(name[1:]): state for name, state in others.items()}


def test_a_spare_worker_starts_in_the_second_half_of_the_limit(pool):
    """It bakes at once when the other is ended. What that one still sends is ignored."""
    assert pool(2, "hangs", "bakes", timeout=0.6) == states(2, _1="timeout")
    first, spare = pool.made
    assert 0.3 < spare.started - first.assigned_at < 0.55 < spare.assigned_at - first.assigned_at
    pool(1, "hangs", "bakes", timeout=0.2)
    assert len(pool.made) == 1  # nothing is left for one
    pool(2, "bakes", timeout=0.6)
    assert len(pool.made) == 1


def test_a_spare_worker_starts_after_a_crash(pool):
    assert pool(4, "crashes", "bakes") == states(4, _1="crash")
    assert len(pool.made) == 3


@pytest.mark.parametrize("others", ["dies", None])
def test_workers_that_do_not_start_end_no_run_while_another_is_well(pool, others):
    """They are tried three times, and a spare one once."""
    assert pool(2, "waits", others, workers=2) == states(2)
    assert len(pool.made) <= 1 + 2 * worker_pool.MOST_STARTS  # before the first bake begins, and after it
    assert pool(3, "crashes", "waits", others) == states(3, _1="crash")
    assert len(pool.made) == 3


def test_workers_are_tried_again_when_the_one_that_is_well_has_ended(pool):
    tries = worker_pool.MOST_STARTS - 1  # before it begins its bake, from when they are counted anew
    dying = ["dies"] * (tries + worker_pool.MOST_STARTS + worker_pool.MOST_STARTS - 1)
    assert pool(3, ("waits", (), 1), *dying, "bakes", workers=2) == states(3)


def test_a_bake_whose_workers_leave_before_it_is_given_to_others(pool):
    assert pool(2, "leaves", "leaves", "bakes") == states(2)
    assert pool(1, "leaves") == states(1, _1="crash")
    assert len(pool.made) == worker_pool.MOST_SENT


@pytest.mark.parametrize("others", ["dies", None])
def test_without_another_worker_the_third_that_does_not_start_ends_the_run(pool, others):
    """Those that ended while another was well do not count."""
    with pytest.raises(NoGpu, match="does not start here: exit code 9"):
        pool(9, "dies", others, workers=2)
    assert len(pool.made) == worker_pool.MOST_STARTS + 1  # two start at once
    assert pool(4, ("waits", (), 1), "dies", "dies", ("waits", (), 1), "dies", "dies", "bakes") == states(4)


def test_workers_that_end_between_their_start_and_their_first_bake_are_not_started_for_ever(pool):
    """As where other machines have all bakes that are left."""
    with pytest.raises(NoGpu, match="before it bakes: exit code 9"):
        pool(1, ("bakes", [Gone()]), looks=10**6)
    assert len(pool.made) == worker_pool.MOST_STARTS


def test_a_first_worker_that_cannot_be_started_leaves_nothing_behind(pool):
    before = len(gc.get_referrers(worker_pool.WorkerPool))
    with pytest.raises(BakeError, match="could not be started: Resource"):
        pool(1, None)
    gc.collect()
    assert len(gc.get_referrers(worker_pool.WorkerPool)) == before


@pytest.mark.slow
@pytest.mark.parametrize(("name", "expected"), [("good", 1), ("crash", 3)])
def test_after_a_crash_there_is_a_spare_worker(folder, monkeypatch, name, expected):
    monkeypatch.setenv("PYTHONPATH", str(SABOTAGE))
    made_, make = [], worker_pool.Worker
    monkeypatch.setattr(worker_pool, "Worker", lambda *more: made_.append(make(*more)) or made_[-1])
    command.run(jobs(folder, name, "a", "b", "c"), may_start_processes=True)
    assert len(made_) == expected


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


def test_what_a_worker_sends_without_a_bake_is_ignored(pool):
    """As one may that a file has taken over."""
    assert pool(1, ("bakes", [Entry(1, "b"), FilesFound(), Ready()]), looks=20) == states(1)
    assert pool.made[0].answered[:3] == [None] * 3


def test_a_worker_that_ends_while_it_has_no_bake_is_replaced(pool):
    assert pool(2, "ends", "bakes") == states(2)
    assert len(pool.made) == 2


@pytest.mark.parametrize(("most", "expected"), [(3, 3), (0, 1)])
def test_a_worker_is_replaced_after_the_bakes_that_it_may_do(pool, most, expected):
    """Blender's Vulkan backend leaves mappings of memory behind each bake."""
    assert pool(9, ("bakes", (), most)) == states(9)
    assert len(pool.made) == expected


def test_a_worker_on_vulkan_may_do_a_hundred_bakes(monkeypatch):
    for backend, expected in (("VULKAN", True), ("OPENGL", False), ("METAL", False)):
        platform = SimpleNamespace(backend_type_get=lambda backend=backend: backend)
        monkeypatch.setattr(job.gpu, "platform", platform)
        assert job.uses_vulkan() == expected
    assert 210 * worker.MOST_ON_VULKAN < 65_530 / 2


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
