# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the scripts that time job files of many sets run, on a few sets."""

import subprocess
import sys

import pytest

from scripts.imprint import ROOT

SCRIPTS = {
    "long_list.py": (["6"], "6 sets in .toml: read in "),
    "many_done.py": (["--count", "3"], "0 done, 3 done before, 0 failed"),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_script_times_a_few_sets(name):
    words, expected = SCRIPTS[name]
    command = [sys.executable, str(ROOT / "scripts" / "dev" / name), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, expected in done.stdout) == (0, True), done.stderr
