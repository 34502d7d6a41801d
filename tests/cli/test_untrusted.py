# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests untrusted files: their scripts do not run, their simulations write no files, and warnings report both."""

import bpy
import pytest

from addon.cli import command, run_report
from tests.support import reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

BAKE = ["s.blend", "--low", "lo", "--high", "hi", "--size", "16", "--limit", "9", "--method", "flatten"]


@pytest.fixture
def high(tmp_path, monkeypatch):
    """The high object of a scene that a test saves as s.blend in the working folder."""
    monkeypatch.chdir(tmp_path)
    zoo.plane("lo")
    return zoo.plane("hi", slope=0.1)


def baked(folder, *words):
    """Bake s.blend. Returns the names of new files, and the warnings in the reports."""
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "s.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    before = set(folder.rglob("*"))
    assert command.run([*BAKE, "--report", "r.json", *words]) == run_report.DONE
    warnings = [warning for each in reports.bake(folder / "r.json")["reports"] for warning in each["warnings"]]
    return sorted(path.name for path in set(folder.rglob("*")) - before), warnings


def test_scripts_that_did_not_run_give_a_warning(tmp_path, high, capfd):
    driver = high.driver_add("location", 2).driver
    driver.expression = "len([1 for i in range(2)])"
    _, warnings = baked(tmp_path, "--output", "m.png")
    (warning,) = warnings
    assert warning.startswith("Scripts of the file were not run, and what they drive stays as saved: Driver 'len(")
    assert f"imprint: warning: {warning}" in capfd.readouterr().err


def test_a_cache_on_the_disk_stays_in_memory(tmp_path, high):
    cloth = high.modifiers.new("Cloth", "CLOTH")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "s.blend"))
    cloth.point_cache.use_disk_cache = True
    written, warnings = baked(tmp_path, "--output", "m.#.png", "--frames", "1-3")
    assert written == ["m.1.png", "m.2.png", "m.3.png", "r.json"]
    assert not [warning for warning in warnings if "Scripts" in warning]


def test_a_fluid_that_writes_files_is_switched_off_with_a_warning(tmp_path, high):
    domain = zoo.plane("domain").modifiers.new("Fluid", "FLUID")
    domain.fluid_type = "DOMAIN"
    domain.domain_settings.cache_type, domain.domain_settings.cache_directory = "REPLAY", "//cache"
    flow = high.modifiers.new("Fluid", "FLUID")
    flow.fluid_type = "FLOW"
    written, warnings = baked(tmp_path, "--output", "m.#.png", "--frames", "1-3")
    assert [name for name in written if name.startswith("fluid")] == []
    assert warnings[0].startswith("The fluid of 'domain' was switched off")


def simulated(folder, high):
    """Give the scene simulations that write files: a cloth with a disk cache, and a fluid on Replay."""
    domain = zoo.plane("domain").modifiers.new("Fluid", "FLUID")
    domain.fluid_type = "DOMAIN"
    domain.domain_settings.cache_type = "REPLAY"
    cloth = high.modifiers.new("Cloth", "CLOTH")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "s.blend"))  # disk caches need a saved file
    cloth.point_cache.use_disk_cache = True


def test_the_saved_scene_keeps_its_simulations(tmp_path, high):
    simulated(tmp_path, high)
    baked(tmp_path, "--output", "m.png", "--save-blend", "s.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "s.blend"))
    fluid, cloth = (bpy.data.objects[name].modifiers[0] for name in ("domain", "hi"))
    assert (fluid.show_viewport, fluid.show_render, cloth.point_cache.use_disk_cache) == (True, True, True)


def test_simulations_of_the_open_file_write_no_files(tmp_path, high, capsys):
    simulated(tmp_path, high)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "s.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "s.blend"))
    before = set(tmp_path.rglob("*"))
    assert command.run([*BAKE[1:], "--output", "m.#.png", "--frames", "1-3"]) == run_report.DONE
    assert sorted(path.name for path in set(tmp_path.rglob("*")) - before) == ["m.1.png", "m.2.png", "m.3.png"]
    assert "The fluid of 'domain' was switched off" in capsys.readouterr().err
