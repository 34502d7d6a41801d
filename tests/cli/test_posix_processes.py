# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests processes that change claims, and the affinity of a process, as Windows does not have them."""

import json
import os
import subprocess
import sys
import time

import pytest

from addon.cli.claims import Claims
from scripts.imprint import ROOT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the other process does nothing there")


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
