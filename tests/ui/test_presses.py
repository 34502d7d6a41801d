# SPDX-License-Identifier: GPL-3.0-or-later
"""The presses of daily tasks in the sidebar, as scripts/dev/presses.py counts them."""

import re
import subprocess
import sys

from scripts.imprint import ROOT

BEFORE = 48
"""Presses that the tasks took in version 0.2: `presses.py --before` counts them."""
EACH = {
    "bake a normal map of a pair": 2,  # the low object, whose high one is found by its name, and Bake
    "make levels of detail": 2,  # the panel More, in which that of the levels is open
    "batch of seven, find the wrong two": 2,
}


def test_daily_tasks_take_half_of_the_presses():
    command = [sys.executable, str(ROOT / "scripts" / "dev" / "presses.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    counted = {
        task: int(number) for task, number in re.findall(r"^(.+?)\s{2,}(\d+) \+ +\d+$", done.stdout, re.MULTILINE)
    }
    assert {task: counted[task] for task in EACH} == EACH
    assert counted["presses + wheel clicks of all"] <= BEFORE / 2
