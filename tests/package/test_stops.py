# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests batches in another process that signals stop, and their output."""

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.support import stops

pytestmark = [
    pytest.mark.usefixtures("gpu_context"),
    pytest.mark.skipif(os.name == "nt", reason="signals of POSIX"),
]

SETS = 300
"""More than any test here finishes."""


def started(folder):
    """A running batch with two finished bakes."""
    process = stops.start(stops.write_sets(folder, SETS), folder)
    while len(list(folder.glob("maps/*.png"))) < 2:
        assert process.poll() is None, (folder / "err.txt").read_text()
        time.sleep(0.01)
    return process


SIGNALS = [
    (signal.SIGTERM, "launcher"),
    (signal.SIGINT, "launcher"),
    (signal.SIGINT, "group"),
    (signal.SIGTERM, "Blender"),
    (signal.SIGHUP, "group"),
]


@pytest.mark.slow
@pytest.mark.parametrize("case", SIGNALS, ids=lambda case: f"{case[0].name} to {case[1]}")
def test_a_signal_stops_a_batch_cleanly(tmp_path, case):
    number, target = case
    process = started(tmp_path)
    assert stops.send(process, number, target)
    code = process.wait(stops.PATIENCE)
    assert list(stops.faults(tmp_path, code, number, process)) == []


@pytest.mark.slow
def test_a_second_signal_ends_a_batch_at_once(tmp_path):
    process = started(tmp_path)
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGINT)
    assert process.wait(stops.PATIENCE) in {128 + signal.SIGTERM, 128 + signal.SIGINT}
    assert not stops.group_lives(process)
    assert stops.partials(tmp_path) == []


@pytest.mark.slow
def test_blender_stops_if_its_launcher_is_killed(tmp_path):
    process = started(tmp_path)
    process.kill()
    process.wait()
    assert not stops.group_lives(process, stops.PATIENCE)
    assert stops.partials(tmp_path) == []


STREAMS = {
    "full": (">/dev/full", "imprint: standard output could not be written: No space left on device.\n"),
    "all closed": ("<&- >&- 2>&-", ""),
    "no reader": ("| true", ""),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", STREAMS)
def test_maps_are_written_even_if_the_output_fails(tmp_path, case):
    redirection, message = STREAMS[case]
    stops.write_sets(tmp_path, 2)
    command = f'"$@" {redirection}; exit ${{PIPESTATUS[0]}}'
    words = [*stops.LAUNCHER, "--jobs", str(tmp_path / "jobs.json")]
    done = subprocess.run(["bash", "-c", command, "bash", *words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", message)
    assert [stops.is_whole(path) for path in tmp_path.glob("maps/*")] == [True, True]


@pytest.mark.slow
def test_standard_output_has_only_imprints_text(tmp_path):
    """Blender prints each file that it reads or writes, and the window system prints warnings."""
    mesh = tmp_path / "low.obj"
    mesh.write_text(stops.LOW)
    program = "import sys, bpy\nbpy.ops.wm.read_homefile(use_empty=True)\n"
    program += "bpy.ops.wm.obj_import(filepath=sys.argv[1])\nbpy.ops.wm.save_mainfile(filepath=sys.argv[2])"
    scene = str(tmp_path / "s.blend")
    subprocess.run([sys.executable, "-c", program, str(mesh), scene], capture_output=True, check=True)
    words = ["--low-file", str(mesh), "--high-file", scene, "--method", "flatten", "--size", "16"]
    words += ["--output", str(tmp_path / "m.png"), "--save-blend", str(tmp_path / "o.blend")]
    done = subprocess.run([*stops.LAUNCHER, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert [line for line in done.stderr.splitlines() if not line.startswith("imprint: warning: ")] == []
    saved, first, *_, last = done.stdout.splitlines()
    assert saved == f"Saved: '{tmp_path / 'm.png'}'"
    assert first.startswith("Flatten, tangent space, 16 x 16: ")
    assert last == f"Wrote {tmp_path / 'm.png'}, {tmp_path / 'o.blend'}"
    assert len(done.stdout.splitlines()) <= 7
