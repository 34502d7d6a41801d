# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what scripts/bake.py loads before it bakes, what it loads only for files that need it, and how it ends."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from addon.cli import blender_process
from addon.core.progress import STARTUP
from scripts.imprint import ROOT
from tests.support import reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

LEFT_OUT = {*blender_process.INTERFACE, *blender_process.ADDONS, *blender_process.NEVER}

LATER = {
    "addon.cli.farm_command",
    "addon.cli.gpu_command",
    "addon.cli.many_bakes",
    "addon.cli.report_command",
    "addon.export.engine_files",
    "addon.jobs.convert",
    "addon.jobs.gpu_test",
    "addon.jobs.lod",
}
"""Modules of commands and options that are loaded at their first use."""

HARMLESS = "EGL Error (0x3009)", "Read blend"
"""The start of lines that Blender prints to standard error, without an effect."""

LOADED = """
import json, runpy, sys
sys.argv = sys.argv[1:]
before = set(sys.modules)
try:
    runpy.run_path(sys.argv[0])
except SystemExit as end:
    import bpy
    assert end.code == 0, end.code
    print(json.dumps(sorted(set(sys.modules) - before)))
    print(json.dumps([addon.module for addon in bpy.context.preferences.addons if addon.module in sys.modules]))
"""
"""Runs scripts/bake.py, and then prints which modules and add-ons were loaded."""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The working folder, with s.blend, whose scene is rendered by Cycles, a_low.obj and a_high.glb."""
    monkeypatch.chdir(tmp_path)
    high = zoo.plane("a_high", slope=0.2)
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "a_high.glb"))
    zoo.plane("a_low")
    bpy.context.scene.render.engine = "CYCLES"
    bpy.context.scene.cycles.samples = 77
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "s.blend"))
    bpy.data.objects.remove(high)
    bpy.ops.wm.obj_export(filepath=str(tmp_path / "a_low.obj"))
    return tmp_path


BLEND = ["s.blend", "--low", "a_low", "--high", "a_high", "--limit", "9", "--size", "16", "--output", "m.png"]
FILES = ["--low-file", "a_low.obj", "--high-file", "a_high.glb", "--limit", "9", "--size", "16", "--output", "m.png"]


def script(*words, program=(), **variables):
    """Run scripts/bake.py in a process of its own."""
    return subprocess.run(
        [sys.executable, *program, str(ROOT / "scripts" / "bake.py"), *words],
        capture_output=True,
        text=True,
        check=True,
        env=dict(os.environ, **variables),
    )


def loaded(*words, **variables):
    """The modules that a bake loaded, without the parts of packages, and the add-ons among them."""
    done = script(*words, program=("-c", LOADED), **variables)
    assert [line for line in done.stderr.splitlines() if not line.startswith(HARMLESS)] == []
    modules, addons = map(json.loads, done.stdout.splitlines()[-2:])
    return set(modules), set(addons)


def test_a_bake_loads_neither_the_interface_nor_add_ons(scene):
    modules, addons = loaded(*BLEND)
    assert not modules & {*LEFT_OUT, "requests", "cattrs", "addon.ui", *LATER}
    assert addons == set()


@pytest.mark.slow
def test_all_is_loaded_where_scripts_of_the_user_may_need_it(scene, tmp_path):
    modules, addons = loaded(*BLEND, BLENDER_SYSTEM_SCRIPTS=str(tmp_path))
    assert modules >= LEFT_OUT
    assert addons >= {*blender_process.ADDONS, "bl_pkg"}


@pytest.mark.skipif(not hasattr(sys, "setdlopenflags"), reason="shared libraries of POSIX")
def test_the_functions_of_blenders_libraries_are_found_when_called(monkeypatch):
    class Finder:
        flags = []

        def find_spec(self, name, *_):
            if name == "bpy":
                self.flags.append(sys.getdlopenflags())
                raise ImportError

    before = sys.getdlopenflags()
    monkeypatch.setattr(sys, "meta_path", [finder := Finder()])
    monkeypatch.delitem(sys.modules, "bpy")
    with pytest.raises(ImportError):
        blender_process.load()
    assert finder.flags == [before & ~os.RTLD_NOW | os.RTLD_LAZY]
    assert (sys.getdlopenflags(), sys.meta_path) == (before, [finder])


@pytest.mark.slow
@pytest.mark.parametrize("words", [FILES, [*BLEND, "--save-blend", "saved.blend"]])
def test_the_interface_is_loaded_for_files_that_need_it(scene, words):
    modules, addons = loaded(*words)
    assert modules >= {*blender_process.INTERFACE, *blender_process.ADDONS}
    assert addons == set(blender_process.ADDONS)
    assert (scene / "m.png").is_file()


@pytest.mark.slow
def test_what_was_left_out_is_loaded_once():
    """Blender prints where a class takes the place of another one."""
    text = "from addon.cli.blender_process import load, complete; load(); complete(); complete()"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True, cwd=ROOT)
    assert "registered before" not in done.stdout + done.stderr


@pytest.mark.slow
def test_a_saved_scene_keeps_its_settings_of_cycles(scene):
    script(*BLEND, "--save-blend", "saved.blend")
    bpy.ops.wm.open_mainfile(filepath=str(scene / "saved.blend"))
    assert (bpy.context.scene.render.engine, bpy.context.scene.cycles.samples) == ("CYCLES", 77)


@pytest.mark.slow
def test_the_engine_of_the_scene_decides_the_basis(scene):
    """Blender reads the engine of a scene wrongly where no add-on has registered it."""
    script(*BLEND, "--report", "r.json")
    assert reports.one(Path("r.json"))["settings"]["basis"] == "CYCLES"


@pytest.mark.slow
def test_the_report_has_the_seconds_before_the_bake(scene):
    script(*BLEND, "--report", "r.json")
    found = reports.one(Path("r.json"))["startup"]
    assert list(found) == list(STARTUP)
    assert {stage for stage, seconds in found.items() if seconds > 0.0} == {*STARTUP} - {"launcher"}


@pytest.mark.slow
def test_each_bake_has_the_seconds_since_the_one_before(scene):
    sets = [
        {"file": name, "low": "a_low", "high": "a_high", "output": f"{name}.png"} for name in ("s.blend", "t.blend")
    ]
    (scene / "t.blend").write_bytes((scene / "s.blend").read_bytes())
    (scene / "j.json").write_text(json.dumps({"defaults": {"size": 16, "limit": 9}, "bake": sets}))
    script("--jobs", "j.json", "--report", "r.json")
    first, second = (entry["reports"][0]["startup"] for entry in reports.bakes(Path("r.json")))
    assert {stage for stage, seconds in first.items() if seconds > 0.0} == {*STARTUP} - {"launcher"}
    assert {stage for stage, seconds in second.items() if seconds > 0.0} == {"gpu", "opening"}


def test_the_process_leaves_no_temporary_folder(scene):
    (scene / "temporary").mkdir()
    command = [sys.executable, str(ROOT / "scripts" / "bake.py"), *BLEND]
    done = subprocess.run(
        command, capture_output=True, check=False, env=dict(os.environ, TMPDIR=str(scene / "temporary"))
    )
    assert done.returncode == 0
    assert list((scene / "temporary").iterdir()) == []


def test_a_process_that_ends_at_once_loses_no_text():
    text = "import bpy; from addon.cli import blender_process; print('last words', end=''); blender_process.end(3)"
    held_back = os.environ | {"PYTHONUNBUFFERED": ""}
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=False, cwd=ROOT, env=held_back
    )
    assert done.returncode == 3
    assert done.stdout.endswith("last words")


def test_in_blender_nothing_ends_at_once(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(app=SimpleNamespace(module=False)))
    monkeypatch.setattr(os, "_exit", lambda _code: pytest.fail("Blender's add-ons had no end"))
    blender_process.end(0)


@pytest.mark.parametrize("name", ["temporary", "blender_of_others"])
def test_files_of_others_stay_where_blender_could_make_no_temporary_folder(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "kept").touch()
    blender_process._remove_temporary(f"{tmp_path / name}{os.sep}")
    assert (tmp_path / name / "kept").is_file()


def test_an_empty_folder_for_all_programs_stays(tmp_path):
    blender_process._remove_temporary(f"{tmp_path}{os.sep}")
    assert tmp_path.is_dir()
