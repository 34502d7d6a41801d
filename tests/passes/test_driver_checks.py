# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the checks of the driver: this driver passes all, and a driver that lies is caught by the right one."""

import gpu
import numpy as np
import pytest

from addon.passes import driver_checks
from addon.passes.driver_checks import DRIVER_CHECKS, CheckFailed
from tests.support.lying_drivers import LIES, Late, anything_is_granted, changed_source, lying

pytestmark = pytest.mark.usefixtures("gpu_context")

BY_NAME = {each.name: each for each in DRIVER_CHECKS}


def finish(check):
    """The result of a check."""
    try:
        while True:
            next(check)
    except StopIteration as end:
        return end.value


@pytest.mark.parametrize("check", DRIVER_CHECKS, ids=BY_NAME)
def test_this_driver_passes(check):
    assert isinstance(finish(check.check()), str)


def test_texels_differ_from_each_other_and_from_seed_to_seed():
    """Otherwise a check would not see that what it reads is another texel, or is of another texture."""
    first, *others = (driver_checks._hashed(1 << 16, seed) for seed in range(24))
    assert ((first >= 1.0) & (first < 2.0)).all()
    assert len(np.unique(first, axis=0)) == len(first)
    assert all((first != other).any(axis=1).sum() > 0.999 * len(first) for other in others)


@pytest.mark.parametrize("turns", [0, 1, 2, 7, 1000])
def test_the_sequence_of_the_long_dispatch(turns):
    expected = np.arange(30, 30 + driver_checks.COMPARED_SIDE**2, dtype=np.uint64)
    for _ in range(turns):
        expected = (expected * np.uint64(1664525) + np.uint64(1013904223)) % np.uint64(2**32)
    values, numbers = driver_checks._sequence(30, turns)
    assert np.array_equal(numbers.ravel(), expected)
    assert np.array_equal(values[..., 0].ravel(), expected >> np.uint64(8))
    assert values.dtype == np.float32


@pytest.mark.parametrize(("lie", "name"), LIES.values(), ids=LIES)
def test_a_driver_that_lies_is_caught(lie, name):
    if lie is anything_is_granted and gpu.platform.backend_type_get() != "OPENGL":
        return  # elsewhere, no driver may be asked for too much
    with lying(lie), pytest.raises(CheckFailed) as found:
        finish(BY_NAME[name].check())
    assert str(found.value).endswith(".")


@pytest.mark.parametrize("most", [2**15, 50_000])
def test_a_limit_of_turns_is_found_and_said(most):
    lie = changed_source("turn < turns", f"turn < min(turns, {most})")
    with lying(lie):
        assert f" after {most:,} turns" in finish(BY_NAME["Loops end where they should"].check())


def test_waiting_needs_no_more_turns_than_drivers_in_software_grant(monkeypatch):
    work, taken = driver_checks._LongDispatch(), []
    monkeypatch.setattr(driver_checks, "LONG_SECONDS", 1e9)
    monkeypatch.setattr(driver_checks, "MOST_SIDE", 4 * driver_checks.COMPARED_SIDE)
    monkeypatch.setattr(work, "run", lambda: taken.append((work.turns, work.values.width)))
    finish(work.grow())
    assert max(turns for turns, _ in taken) == driver_checks.SAFE_TURNS
    assert taken[-1] == (driver_checks.SAFE_TURNS, driver_checks.MOST_SIDE)


def test_each_check_has_a_lie():
    assert {name for _, name in LIES.values()} == set(BY_NAME)


def test_an_asynchronous_driver_that_waits_passes():
    with lying(lambda patch: Late(patch, waits=True)):
        for name in ("Read-backs wait", "Waiting waits"):
            finish(BY_NAME[name].check())
