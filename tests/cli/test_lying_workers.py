# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that a worker which a file has taken over can say nothing that harms the run: it ends, and its bake is named at once.

The workers are plain programs that send what a test says: tests/support/lying_worker.py. No Blender starts.
"""

import io
import json
import struct
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from addon.cli import clashes, job_file, plans, worker_process
from addon.cli.options import RunOptions
from addon.cli.run_report import Entry, State
from addon.cli.terminal import Events
from addon.cli.untrusted import Bounds
from addon.cli.work_queue import WorkQueue
from addon.cli.worker_messages import Accepted, FilesFound, Line, Percent, Ready, Turns, WrongMessage, packed, unpacked
from addon.cli.worker_pool import WorkerPool
from addon.core.errors import NoGpu
from scripts.imprint import ROOT

NAMED = 5.0
"""Seconds until the bake of a worker that lies is named, with those that its processes take to start."""
HONEST = Entry(2, "honest", State.FAILED, "No.")
LIAR = Entry(1, "liar", State.FAILED, "No.", chain={"": 0})


def message(content):
    return "message", content.decode("latin-1")


def raw(content):
    return "raw", content.decode("latin-1")


def entry(**values):
    return message(packed(replace(LIAR, **values)))


def spelled(old, new, of=LIAR):
    """An entry in whose text something is replaced, as json.dumps does not write it."""
    content = packed(of)
    assert old in content
    return message(content.replace(old, new))


SECONDS, NESTED = b'"seconds": 0.0', b'"chain": {"": 0}'
BEGUN, READY = message(packed(Accepted())), message(packed(Ready()))
LEAVE = "leave", "0"
FOUND = packed(FilesFound(["a"], []))
WAYS = {
    "a number of 400 digits": [spelled(SECONDS, b'"seconds": 1' + b"0" * 400)],
    "a number of 10,000 digits": [spelled(SECONDS, b'"seconds": 1' + b"0" * 10_000)],
    "a number of 20 digits in a report": [spelled(NESTED, b'"chain": {"a": 10000000000000000000}')],
    "not a number": [spelled(SECONDS, b'"seconds": NaN')],
    "without end": [spelled(SECONDS, b'"seconds": Infinity')],
    "without end, as a number": [spelled(SECONDS, b'"seconds": 1e999')],
    "not a number in a report": [spelled(NESTED, b'"chain": {"a": [{"b": NaN}]}')],
    "less than no time": [entry(seconds=-1.0)],
    "true as a number": [spelled(SECONDS, b'"seconds": true')],
    "a text as a number": [entry(seconds="1")],
    "a number as a text": [entry(error=7)],
    "a list as a text": [entry(name=["liar"])],
    "nested 100 times": [spelled(NESTED, b'"chain": {"a": ' + b"[" * 100 + b"]" * 100 + b"}")],
    "nested 100,000 times": [spelled(NESTED, b'"chain": ' + b"[" * 100_000)],
    "a long text": [message(packed(Line("x" * 100_000)))],
    "a text that is none": [message(packed(Line("\ud800")))],
    "millions of values": [spelled(NESTED, b'"chain": {"a": [' + b"0," * (1 << 22) + b"0]}")],
    "a share above 1": [message(packed(Percent("a", "b", 1.5)))],
    "a share below 0": [message(packed(Percent("a", "b", -0.5)))],
    "a share that is not a number": [message(packed(Percent("a", "b", float("nan"))))],
    "an unknown kind": [message(b'["Ended", {}]')],
    "no JSON": [message(b"garbage")],
    "no UTF-8": [message(b'["Line", {"line": "\xff"}]')],
    "nothing": [message(b"")],
    "three values": [message(b'["Line", {"line": "a"}, 1]')],
    "another key": [message(b'["Line", {"line": "a", "more": 1}]')],
    "no key": [message(b'["Percent", {"subject": "a"}]')],
    "a picture of a line": [message(packed(Line("a")) + b"\0\x89PNG")],
    "a length below 0": [raw(struct.pack("!i", -2))],
    "a length of 2 GiB": [raw(struct.pack("!i", (1 << 31) - 1))],
    "a length of 8 EiB": [raw(struct.pack("!iQ", -1, 1 << 63))],
    "half a length": [raw(b"\0\0")],
    "half a message": [raw(struct.pack("!i", 1000) + b"[")],
    "a message that never ends": [("drip", (struct.pack("!i", 1000) + b"[" * 1000).decode("latin-1"))],
    "its end closed": [("close",)],
    "half of its end closed": [("write no more",)],
    "the other half closed": [("read no more",), message(FOUND)],
    "half a message, then its end closed": [raw(struct.pack("!i", 1000) + b"["), ("close",)],
    "begun twice": [BEGUN],
    "ready twice": [READY],
    "another number": [entry(number=2)],
    "another name": [entry(name="honest")],
    "stopped": [entry(state=State.STOPPED)],
    "not in the report": [entry(is_listed=False)],
    "done before": [entry(state=State.RESUMED), LEAVE],
    "done without a file": [entry(state=State.DONE), LEAVE],
    "a file of the system": [
        entry(files=[{"path": "/etc/passwd", "bytes": 1, "sha256": "0" * 64, "what": "map"}]),
        LEAVE,
    ],
    "a file in no folder": [entry(files=[{"path": "m.png", "bytes": 1, "sha256": "0" * 64, "what": "map"}])],
    "a report that is none": [entry(reports=[{}])],
    "too many files": [message(packed(FilesFound(["a"] * 30_000, [])))],
    "files without end": [("flood", FOUND.decode("latin-1"))],
    "lines without end": [("pour", packed(Line("a")).decode("latin-1"))],
    "its process ended": [LEAVE],
}
BEFORE = {
    "an end before the beginning": [entry()],
    "progress before the beginning": [message(packed(Percent("a", "b", 0.5)))],
}


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A function that has workers with these steps do two bakes. Returns their entries, and the events."""
    assert worker_process.LONGEST_SEND < NAMED / 2.0
    monkeypatch.setattr(worker_process, "LONGEST_SEND", 0.5)
    monkeypatch.chdir(tmp_path)
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    sets = [
        {"low-file": "in/a.obj", "high-file": "in/b.obj", "output": f"out/{name}.png", "name": name}
        for name in ("liar", "honest")
    ]
    (tmp_path / "j.json").write_text(json.dumps({"bake": sets}))
    planned = [replace(plan, name=plan.options.name) for plan in plans.plans_of(job_file.read("j.json"))[0]]
    bounds = Bounds(str(tmp_path / "in"), str(tmp_path / "out"))
    files = clashes.RunFiles(bounds=bounds)
    assert files.add([(plan.name, plan.options) for plan in planned]) == []

    def start(steps, ready=(READY,)):
        honest = [BEGUN, message(packed(HONEST))]
        (tmp_path / "steps.json").write_text(json.dumps({"ready": ready, "liar": steps, "honest": honest}))
        words = [sys.executable, "-S", str(ROOT / "tests/support/lying_worker.py"), str(tmp_path / "steps.json")]
        sandbox = SimpleNamespace(
            command=lambda *_: words, environment=dict, bounds=bounds, folders=(bounds.inputs, bounds.outputs)
        )
        events, begun = io.StringIO(), time.monotonic()
        with WorkerPool(RunOptions(untrusted=True, timeout=2.0 * NAMED), sandbox) as pool:
            found = []
            for each in pool.bake_all(WorkQueue(planned), files, Events(events)):
                found.append((each, time.monotonic() - begun))
        return found, list(map(json.loads, events.getvalue().splitlines()))

    return start


def cases():
    """All ways. Those that the test of single messages sees as well are slow, but for a few."""
    for place, (name, steps) in enumerate(WAYS.items()):
        is_slow = place > 3 and steps[0][0] == "message" and len(steps) == 1
        yield pytest.param([BEGUN, *steps], id=name, marks=[pytest.mark.slow] if is_slow else [])
    yield from (pytest.param(steps, id=name) for name, steps in BEFORE.items())


@pytest.mark.parametrize("steps", list(cases()))
def test_a_worker_that_lies_ends_and_its_bake_is_named(run, steps):
    found, events = run(steps)
    by_name = {entry.name: (entry, seconds) for entry, seconds in found}
    liar, seconds = by_name["liar"]
    assert (liar.number, liar.state, bool(liar.error)) == (1, State.FAILED, True)
    assert liar.error != LIAR.error  # which its process made up
    assert seconds < NAMED
    assert by_name["honest"][0].error == HONEST.error
    assert not [each for each in events if not 0.0 <= each.get("percent", 0.0) <= 100.0]


ALONE = {name: steps[0] for name, steps in WAYS.items() if len(steps) == 1 and steps[0][0] == "message"}


@pytest.mark.parametrize("step", ALONE.values(), ids=ALONE)
def test_a_message_that_lies_is_none(step):
    turns, plan = Turns(), SimpleNamespace(number=1, name="liar")
    for each in (Ready(), Accepted()):
        turns.check(each, plan)
    with pytest.raises(WrongMessage):
        turns.check(unpacked(step[1].encode("latin-1"), is_trusted=False), plan)


def test_a_second_end_is_not_taken_for_that_of_the_next_bake(run):
    found, _ = run([BEGUN, entry(), entry(number=2, name="honest")])
    assert [(each.name, each.error) for each, _ in found] == [("liar", "No."), ("honest", "No.")]
    assert found[-1][1] < NAMED


def test_a_worker_that_takes_no_other_bake_keeps_none_waiting(run, monkeypatch):
    """As one that a file has taken over: the next bake would wait for its time limit, an hour."""
    monkeypatch.setattr(worker_process, "LONGEST_BEGIN", 0.5)
    found, _ = run([BEGUN, entry()])
    assert [(each.name, each.error) for each, _ in found] == [("liar", "No."), ("honest", "No.")]
    assert found[-1][1] < NAMED


@pytest.mark.parametrize("first", [[BEGUN], [entry()], [message(b"garbage")], [raw(b"\0")]])
def test_workers_that_lie_before_they_are_ready_end_the_run(run, first):
    begun = time.monotonic()
    with pytest.raises(NoGpu):
        run([], ready=first)
    assert time.monotonic() - begun < 3 * NAMED


def test_what_workers_send_in_turn_is_taken():
    """Also a long chain of reports, and names that are not UTF-8."""
    turns, plan = Turns(), SimpleNamespace(number=1, name="liar")
    nested = {"a": [{"b": {"c": [1, 2.5, None, True, "x\udc80"]}}]}
    for each in (
        Ready(3),
        *(Accepted(), Line("a"), FilesFound(["a"], [("b", "c")]), Percent("a", "b", 0), replace(LIAR, chain=nested)),
        *(Accepted(), LIAR),
    ):
        found = unpacked(packed(each), is_trusted=False)
        assert found == each
        turns.check(found, plan)
    with pytest.raises(WrongMessage):
        turns.check(LIAR, plan)
