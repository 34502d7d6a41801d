# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests claims on bakes, with processes that have them at the same time and processes that are killed."""

import errno
import os
import random
import signal
import subprocess
import sys
import time

import pytest

from addon.cli import claims
from addon.cli.claims import EMPTY_FOR, LEFT_AFTER, Claims
from scripts.imprint import ROOT
from tests.support import random_cases

HOLD = """
import sys
from pathlib import Path
from addon.cli.claims import Claims
held = Claims(machine=sys.argv[2], beat=float(sys.argv[3]))
print(held.take(Path(sys.argv[1])), flush=True)
sys.stdin.read()
held.close()
"""
TAKE_ALL = """
import random, sys, time
from pathlib import Path
from addon.cli.claims import Claims
folder, name, seed = Path(sys.argv[1]), sys.argv[2], random.Random(sys.argv[3])
print("ready", flush=True)
sys.stdin.readline()
with Claims(machine=sys.argv[4]) as held:
    for number in range(60):
        lock = folder / f"{number}.lock"
        if held.take(lock):
            try:
                (folder / f"{number}.working").mkdir()  # fails while another one has it
            except FileExistsError:
                print("both have", number)
            with (folder / f"{number}.done").open("a") as file:
                file.write(name + "\\n")
            time.sleep(seed.random() * 0.002)
            (folder / f"{number}.working").rmdir()
            if seed.random() < 0.5:
                held.release(lock)
"""
FAKE = "0" * 8
"""Another machine."""


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


def start(program, *words):
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, words)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def other(tmp_path):
    """Starts another process that has the claim "lock", by its machine and its seconds between two beats."""
    started = []

    def of(machine="", beat=0.05):
        started.append(start(HOLD, tmp_path / "lock", machine, beat))
        assert started[-1].stdout.readline() == "True\n"
        return started[-1]

    yield of
    for process in started:
        process.kill()
        process.communicate()


def names(folder):
    return sorted(os.listdir(folder))


def test_a_claim_is_one_process_s_until_it_gives_it_up(tmp_path):
    lock = tmp_path / "lock"
    with Claims() as first, Claims() as second:
        assert first.take(lock)
        assert not second.take(lock)
        first.release(lock)
        assert second.take(lock)
        first.release(lock)  # it is no longer its own
        assert not first.take(lock)
    assert names(tmp_path) == []


def test_a_process_that_works_is_not_disturbed_by_another_one(tmp_path, other):
    """The clock of this machine goes on by hours; that of files by hours in both directions."""
    process, clock = other(), Clock()
    with Claims(clock) as held:
        for hours in (0, -5, 5):
            os.utime(tmp_path / "lock", (time.time() + hours * 3600,) * 2)
            assert not held.take(tmp_path / "lock")
            before = (tmp_path / "lock").read_bytes()
            while (tmp_path / "lock").read_bytes() == before:
                time.sleep(0.01)
            clock.now += 3600
        process.communicate("")
        assert held.take(tmp_path / "lock")


def test_a_claim_of_a_killed_process_is_taken_at_once(tmp_path, other):
    process = other()
    with Claims(Clock()) as held:
        assert not held.take(tmp_path / "lock")
        process.kill()
        process.wait()
        assert held.take(tmp_path / "lock")
    assert names(tmp_path) == []


def test_a_claim_of_another_machine_is_taken_after_it_was_watched(tmp_path, other):
    process, clock = other(FAKE), Clock()
    process.kill()
    process.wait()
    os.utime(tmp_path / "lock", (0, 0))  # age says nothing
    with Claims(clock) as held:
        for _ in range(7):
            assert not held.take(tmp_path / "lock")
            clock.now += (LEFT_AFTER - 1) / 7
        assert not held.take(tmp_path / "lock")
        clock.now += 2
        assert held.take(tmp_path / "lock")


def test_a_change_of_a_claim_starts_the_watch_again(tmp_path, other):
    process, clock = other(FAKE), Clock()
    with Claims(clock) as held:
        for _ in range(5):
            assert not held.take(tmp_path / "lock")
            before = (tmp_path / "lock").read_bytes()
            while (tmp_path / "lock").read_bytes() == before:
                time.sleep(0.01)
            clock.now += LEFT_AFTER * 2
        process.kill()


@pytest.mark.parametrize("content", [b"{", b"[1]", b"\xff", b'{"machine": 3}'])
def test_a_claim_of_a_process_that_was_killed_as_it_wrote_it_is_taken_later(tmp_path, content):
    (tmp_path / "lock").write_bytes(content)
    clock = Clock()
    with Claims(clock) as held:
        assert not held.take(tmp_path / "lock")
        clock.now += LEFT_AFTER
        assert held.take(tmp_path / "lock")


def test_a_claim_that_was_never_written_is_taken_soon(tmp_path):
    (tmp_path / "lock").touch()
    clock = Clock()
    with Claims(clock) as held:
        assert not held.take(tmp_path / "lock")
        clock.now += EMPTY_FOR / 2
        assert not held.take(tmp_path / "lock")
        clock.now += EMPTY_FOR / 2
        assert held.take(tmp_path / "lock")


def test_a_new_claim_that_is_taken_for_an_old_one_is_put_back(tmp_path):
    """Two processes watch a claim that was left. The second one comes when the first has its own already."""
    lock, clock = tmp_path / "lock", Clock()
    lock.write_bytes(b"left")
    with Claims(clock, FAKE) as first, Claims(clock) as second:
        assert not first.take(lock)
        assert not second.take(lock)
        clock.now += LEFT_AFTER
        late = second._left(lock)
        assert first.take(lock)
        content = lock.read_bytes()
        assert not claims._remove(lock, lambda now: now == late)
        assert lock.read_bytes() == content
        assert not second.take(lock)
        first.release(lock)
        assert second.take(lock)


def test_a_process_whose_claim_was_taken_over_does_not_give_up_that_of_the_other(tmp_path):
    """A machine that was asleep for long."""
    lock, clock = tmp_path / "lock", Clock()
    with Claims(clock, FAKE, beat=0.02) as asleep, Claims(clock) as held:
        assert asleep.take(lock)
        lock.rename(tmp_path / "gone")
        assert held.take(lock)
        content = lock.read_bytes()
        time.sleep(0.1)  # it wakes up, and changes its own file
        assert lock.read_bytes() == content
        asleep.release(lock)
        assert lock.read_bytes() == content


def test_a_claim_on_a_full_disk_is_given_up(tmp_path, monkeypatch):
    """A file can be created there, but not written, nor can a further one be created."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with Claims() as held:
        monkeypatch.setattr(os, "write", full)
        assert held.take(tmp_path / "a.lock")
        monkeypatch.setattr(os, "open", full)
        held.release(tmp_path / "a.lock")
    assert list(tmp_path.iterdir()) == []


def test_folders_are_made_and_removed_if_nothing_is_in_them(tmp_path):
    with Claims() as held:
        assert held.take(tmp_path / "a" / "b" / "lock")
        assert held.take(tmp_path / "c" / "lock")
        (tmp_path / "c" / "map.png").touch()
    assert names(tmp_path) == ["c"]
    assert names(tmp_path / "c") == ["map.png"]


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    with Claims() as held, pytest.raises(OSError):
        held.take(tmp_path / "file" / "lock")


@pytest.mark.parametrize("machines", [("", "", ""), ("", FAKE, "1" * 8)], ids=["one machine", "three machines"])
def test_processes_never_have_a_claim_at_the_same_time(tmp_path, machines):
    processes = [start(TAKE_ALL, tmp_path, name, name, machine) for name, machine in zip("abc", machines, strict=True)]
    for process in processes:
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.stdin.write("\n")
        process.stdin.flush()
    assert [process.communicate()[0] for process in processes] == ["", "", ""]
    left = [name for name in names(tmp_path) if not name.endswith(".done")]
    assert left == []
    assert len(names(tmp_path)) == 60


@random_cases.seeds(3, fast=2)
def test_a_kill_at_any_moment_leaves_nothing_that_stops_the_next_process(tmp_path, seed):
    process = start(TAKE_ALL, tmp_path, "a", seed, "")
    process.stdout.readline()
    process.stdin.write("\n")
    process.stdin.flush()
    while not list(tmp_path.glob("*.done")):
        time.sleep(0.001)
    time.sleep(random.Random(seed).random() * 0.15)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    clock = Clock()
    with Claims(clock) as held:
        left = [number for number in range(60) if not held.take(tmp_path / f"{number}.lock")]
        assert [number for number in left if (tmp_path / f"{number}.lock").stat().st_size] == []
        clock.now += EMPTY_FOR
        assert [number for number in left if not held.take(tmp_path / f"{number}.lock")] == []
    assert [name for name in names(tmp_path) if not name.endswith((".done", ".working"))] == []
