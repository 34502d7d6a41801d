# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which results are remembered."""

from addon.core.recent import Recent


def test_the_last_ones_that_were_asked_for_or_set_stay():
    recent = Recent(2)
    recent["a"], recent["b"] = 1, 2
    assert recent.get("a") == 1
    recent["c"] = 3
    assert (recent.get("a"), recent.get("b"), recent.get("c")) == (1, None, 3)
    recent["a"] = 4
    recent["d"] = 5
    assert (len(recent), recent.get("a"), recent.get("c")) == (2, 4, None)
    recent.clear()
    assert recent.get("a") is None
