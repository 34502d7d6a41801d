# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Levels of Detail and its operator."""

import bpy
import pytest

from tests.support import zoo
from tests.support.panel import use
from tests.support.panel_layout import draw

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def settings():
    """The settings of the scene, for small maps of an active terrain."""
    bpy.context.view_layer.objects.active = zoo.terrain("Hill", 12)
    return use(size=64, storage="MEMORY")


def test_the_panel_shows_the_limits_and_the_button(settings):
    drawn = draw()
    assert {"level_degrees", "level_distance", "export"} <= set(drawn.properties)
    assert ("imprint.make_levels", True) in drawn.buttons


def test_the_button_makes_a_level_for_each_limit(settings):
    settings.level_degrees, settings.level_distance = "", "2, 4"
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    assert [obj.name for obj in bpy.data.collections["Hill_LODs"].objects] == ["Hill_LOD1", "Hill_LOD2"]
    assert bpy.context.window_manager.imprint_summary.startswith("Hill_LOD1: ")


@pytest.mark.parametrize(
    ("name", "files"), [("hill.glb", ["hill.glb"]), ("{low}.usd", ["Hill_LOD1.usd", "Hill_LOD2.usd"])]
)
def test_the_button_writes_files_for_an_engine(settings, tmp_path, name, files):
    settings.level_degrees, settings.level_distance = "", "2, 4"
    settings.export = str(tmp_path / name)
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    assert sorted(path.name for path in tmp_path.glob("*.*")) == files
    assert bpy.context.window_manager.imprint_summary.splitlines()[-1].startswith(f"Wrote {tmp_path / files[0]}")
    if name.endswith(".glb"):
        assert b"MSFT_lod" in (tmp_path / name).read_bytes()


@pytest.mark.parametrize(
    ("path", "text"), [("hill.usd", "put {low} into"), ("hill.obj", "no file for an engine"), ("//hill.glb", "save it")]
)
def test_a_file_that_cannot_take_levels_is_refused_before_they_are_made(settings, path, text):
    settings.level_degrees, settings.level_distance, settings.export = "", "2, 4", path
    with pytest.raises(RuntimeError, match=text):
        bpy.ops.imprint.make_levels()
    assert len(bpy.data.objects) == 1


def test_levels_stay_where_their_file_cannot_be_written(settings, tmp_path):
    settings.level_degrees, settings.level_distance = "", "4"
    (tmp_path / "none").write_text("a file, not a folder")
    settings.export = str(tmp_path / "none" / "hill.glb")
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    assert len(bpy.data.objects) == 2
    assert bpy.context.window_manager.imprint_warnings


def test_the_usual_limits_are_valid_and_wrong_ones_are_reported(settings):
    assert (settings.level_degrees, settings.level_distance) == ("1, 2, 4", "1")
    settings.level_degrees = "one"
    with pytest.raises(RuntimeError, match="are not degrees"):
        bpy.ops.imprint.make_levels()
    bpy.context.view_layer.objects.active = None
    settings.level_degrees = "1"
    with pytest.raises(RuntimeError, match="No object is active"):
        bpy.ops.imprint.make_levels()
    assert len(bpy.data.objects) == 1
