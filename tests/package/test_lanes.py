# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that tests/pure needs no Blender."""

import subprocess
import sys

import pytest

from scripts.imprint import ROOT

WITHOUT_BLENDER = """
import sys

import pytest

for name in ("bpy", "gpu", "bmesh", "mathutils"):
    sys.modules[name] = None  # importing it is an ImportError
sys.exit(pytest.main(sys.argv[1:]))
"""


def run(*arguments):
    """Run pytest without Blender's modules. Returns its exit code and output."""
    command = [sys.executable, "-c", WITHOUT_BLENDER, "-q", "-p", "no:cacheprovider", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
def test_pure_tests_pass_without_blender():
    code, output = run("tests/pure")
    assert code == pytest.ExitCode.OK, output
    assert " passed" in output
    assert " skipped" not in output


def test_pure_tests_skip_nothing_on_any_system():
    """Tests that need links, locks or signals of POSIX are in other folders."""
    texts = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "tests" / "pure").glob("*.py")}
    assert texts
    assert [name for name, text in texts.items() if "skip" in text] == []


def test_no_two_files_have_the_same_name():
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert len(set(names)) == len(names)


def test_other_tests_need_blender():
    """Otherwise the test of the pure ones would show nothing."""
    code, output = run("--collect-only", "tests/passes/test_shader.py")
    assert code != pytest.ExitCode.OK
    assert "bpy" in output or "gpu" in output
