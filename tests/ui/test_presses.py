# SPDX-License-Identifier: GPL-3.0-or-later
"""The presses of daily tasks in the sidebar, as scripts/dev/presses.py counts them."""

import re
import subprocess
import sys

from scripts.imprint import ROOT
from tests.support.daily_tasks import BEFORE, PRESSES


def test_daily_tasks_take_half_of_the_presses():
    command = [sys.executable, str(ROOT / "scripts" / "dev" / "presses.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = {task: int(number) for task, number in re.findall(r"^(.+?)\s{2,}(\d+) \+ +\d+$", done.stdout, re.MULTILINE)}
    assert {task: found[task] for task in PRESSES} == PRESSES
    assert found["presses + wheel clicks of all"] == sum(PRESSES.values()) <= BEFORE / 2
