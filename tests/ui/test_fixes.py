# SPDX-License-Identifier: GPL-3.0-or-later
"""What warnings and errors say in the window, and the buttons that fix them."""

import re

import bpy
import numpy as np
import pytest

from addon.cli.arguments import parser
from addon.core.errors import Fix, in_window
from addon.jobs import bake_jobs
from addon.ui import bake_panel
from addon.ui.bake_results import results
from addon.ui.checks import FIXES
from addon.ui.properties import Chosen
from tests.support import panel_layout, zoo
from tests.support.panel import use

pytestmark = pytest.mark.usefixtures("registered")


def set_up(low, *highs, **values):
    """`low` in the slot with high objects, and a small map."""
    settings = use(low, *highs, size=64, **values)
    bpy.context.view_layer.update()
    return settings


def flipped(obj):
    obj.data.flip_normals()
    return obj


def drawn_fixes():
    """The text of the main panel, and the kinds of its buttons."""
    drawn = panel_layout.draw(width=3000)
    return drawn.text, [given.kind for name, given in drawn.given if name == "imprint.cure"]


# Options and buttons


@pytest.mark.parametrize("kind", Fix.__members__)
def test_each_fix_is_an_option_of_the_shell_and_a_button(kind):
    fix, settings = Fix[kind], bpy.context.scene.imprint
    words = re.findall(r"--([a-z-]+)", fix.in_shell)
    known = set(re.findall(r"^ +(?:-\w, )?--([a-z-]+)", parser("imprint").format_help(), re.MULTILINE))
    assert words
    assert set(words) <= known
    assert kind in FIXES
    assert settings.bl_rna.properties[fix.setting]
    assert in_window(Fix[kind].after("Something is wrong.")) == ("Something is wrong.", kind)


@pytest.mark.parametrize("kind", Fix.__members__)
def test_a_button_sets_its_setting(kind):
    fix = Fix[kind]
    others = {
        "method": "FLATTEN",
        "hit": "OUTERMOST",
        "measure": False,
        "depth": "16",
        "samples": "1",
        "material": True,
    }
    settings = set_up(zoo.plane("lo"), zoo.terrain("hi", 8))
    setattr(settings, fix.setting, others.get(fix.setting, False))
    assert bpy.ops.imprint.cure(kind=kind) == {"FINISHED"}
    assert getattr(settings, fix.setting) == fix.new_value


def test_a_warning_of_a_bake_is_a_sentence_and_a_button(gpu_context):
    low, high = zoo.plane("lo"), zoo.terrain("hi", 24)
    settings = set_up(low, high, method="CAST", measure=False, extrusion=0.01, max_distance=0.02, material=False)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    (warning,) = results.of(bpy.context, low).warnings
    assert "--extrusion" in warning
    text, kinds = drawn_fixes()
    assert "hit nothing within the extrusion" in text
    assert "--" not in text
    assert kinds == [Fix.MEASURE.name]
    bpy.ops.imprint.cure(kind=kinds[0])
    assert settings.chosen(bpy.context, low).rays.measure
    assert not settings.measure  # that of other low objects
    bpy.ops.imprint.bake()
    assert results.of(bpy.context, low).warnings == []


def test_a_linked_low_object_is_named_before_the_bake_with_a_button(tmp_path, gpu_context):
    path = str(tmp_path / "lo.blend")
    bpy.data.libraries.write(path, {zoo.plane("lo")})
    bpy.data.objects.remove(bpy.data.objects["lo"])
    with bpy.data.libraries.load(path, link=True) as (_, loaded):
        loaded.objects = ["lo"]
    bpy.context.scene.collection.objects.link(loaded.objects[0])
    low, high = loaded.objects[0], zoo.terrain("hi", 8)
    settings = set_up(low, high)
    problem = bake_panel.bake_problem(bpy.context, Chosen(settings, low, [high]))
    assert problem.endswith("make it local first; --no-material leaves them as they are.")
    text, kinds = drawn_fixes()
    assert "make it local first." in text
    assert "--" not in text
    assert kinds == [Fix.NO_MATERIAL.name]
    with pytest.raises(RuntimeError, match=r"make it local first\.\n?$"):
        bpy.ops.imprint.bake()
    bpy.ops.imprint.cure(kind=Fix.NO_MATERIAL.name)
    assert not settings.material
    assert bake_panel.bake_problem(bpy.context, Chosen(settings, low, [high])) == ""
    settings.connect_maps = True  # the same is checked for other maps
    # Without the setting Material it would be an error, too.
    assert bake_panel.bake_problem(bpy.context, Chosen(settings, low, [high])).endswith("make it local first.")


# Flipped meshes


PAIRS = {
    "planes": lambda: (zoo.plane("lo"), zoo.terrain("hi", 24)),
    "cubes": lambda: (zoo.cube("lo"), zoo.cube("hi")),
    "balls with normals of their own": lambda: (zoo.sphere("lo", 6), zoo.sphere("hi", 24)),
    "side by side": lambda: beside(zoo.cube("lo"), zoo.cube("hi")),
    "mirrored objects": lambda: mirrored(zoo.plane("lo"), zoo.terrain("hi", 24)),
    "one of them mirrored": lambda: (zoo.plane("lo"), mirrored(zoo.terrain("hi", 24))[0]),
    "an object without faces": lambda: (zoo.plane("lo"), zoo.build("hi", [(0, 0, 0)], np.empty((0, 3), int))),
}


def beside(low, high):
    high.location.x = 5.0
    return low, high


def mirrored(*objects):
    for obj in objects:
        obj.scale.x = -1.0
    return objects


@pytest.mark.parametrize("name", PAIRS)
def test_faces_to_the_same_side_are_no_finding(name):
    low, high = PAIRS[name]()
    set_up(low, high)
    assert "FLIPPED" not in drawn_fixes()[1]


@pytest.mark.parametrize("name", [name for name in PAIRS if "without" not in name])
def test_a_flipped_low_object_is_found_before_the_bake_and_fixed_by_a_button(name):
    low, high = PAIRS[name]()
    set_up(flipped(low), high)
    text, kinds = drawn_fixes()
    assert "The faces of 'lo' point to the other side than those of 'hi'" in text
    assert kinds == ["FLIPPED"]
    normals = np.array([polygon.normal[:] for polygon in low.data.polygons])
    corners = np.array([corner.vector[:] for corner in low.data.corner_normals])
    assert bpy.ops.imprint.cure(kind="FLIPPED") == {"FINISHED"}
    np.testing.assert_allclose([polygon.normal[:] for polygon in low.data.polygons], -normals, atol=1e-6)
    after = np.array([corner.vector[:] for corner in low.data.corner_normals])
    assert np.sort(after, axis=0) + np.sort(corners, axis=0)[::-1] == pytest.approx(0.0, abs=1e-5)
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == []


def test_a_flipped_closed_high_object_is_the_one_that_is_flipped():
    low, high = zoo.cube("lo"), flipped(zoo.cube("hi"))
    set_up(low, high)
    assert "The faces of 'hi' point to the other side than those of 'lo'" in drawn_fixes()[0]
    before = [polygon.normal[:] for polygon in low.data.polygons]
    bpy.ops.imprint.cure(kind="FLIPPED")
    assert [polygon.normal[:] for polygon in low.data.polygons] == before
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == []
    with pytest.raises(RuntimeError, match="point to the same sides"):
        bpy.ops.imprint.cure(kind="FLIPPED")


def test_the_panel_looks_again_when_an_object_turns():
    low, high = zoo.plane("lo"), zoo.terrain("hi", 12)
    set_up(low, high)
    assert drawn_fixes()[1] == []
    low.rotation_euler.y = np.pi
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == ["FLIPPED"]
    low.rotation_euler.y = 0.0
    high.data.flip_normals()
    high.data.update()
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == ["FLIPPED"]


def test_sheets_with_two_sides_are_no_finding():
    up, down = zoo.plane("lo", 4), flipped(zoo.plane("down", 4))
    with bpy.context.temp_override(active_object=up, selected_editable_objects=[up, down]):
        bpy.ops.object.join()
    set_up(up, zoo.terrain("hi", 12))
    assert drawn_fixes()[1] == []


def test_a_shell_says_it_before_the_bake(gpu_context):
    steps = []
    low, high = flipped(zoo.plane("lo")), zoo.terrain("hi", 24)
    settings = set_up(low, high, material=False).to_settings()
    (report,) = bake_jobs.bake_all(bpy.context, [bake_jobs.Job(low, [high])], settings, on_progress=steps.append)
    early = [warning for step in steps for warning in step.warnings]
    assert early == report.warnings
    assert len(early) == 1
