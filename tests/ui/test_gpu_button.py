# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the button Test My GPU, what the preferences show of the last test, and its report."""

import json
from dataclasses import replace
from types import SimpleNamespace

import bpy
import pytest

from addon.core.errors import NoGpu
from addon.core.gpu_report import GpuReport, Outcome, Verdict
from addon.core.progress import Progress
from addon.jobs import gpu_test as job
from addon.ui import gpu_button
from addon.ui.gpu_button import last
from addon.ui.live import live
from addon.ui.progress_display import display
from tests.support import panel
from tests.support.panel_layout import Layout

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")

KEPT = Outcome("Read-backs wait", Verdict.RIGHT)
RIGHT = GpuReport({}, {}, [KEPT], [Outcome("Cast: normal", Verdict.EQUAL, "", 0, 4, 0.0, "degrees")])
WRONG = GpuReport({}, {}, [KEPT], [Outcome(f"Pair {number}", Verdict.WRONG, "bad") for number in range(9)])


@pytest.fixture(autouse=True)
def no_report():
    last.report = None
    yield
    last.report = None


@pytest.fixture
def found(monkeypatch):
    """Makes the test find a report, or raise an error, in one step."""

    def set_result(result):
        def work(pace):
            yield job.STEP
            if isinstance(result, Exception):
                raise result
            return result

        monkeypatch.setattr(job, "work", work)

    return set_result


def drawn():
    """What the preferences show of the test."""
    layout = Layout()
    system = SimpleNamespace(ui_scale=1.0)
    context = SimpleNamespace(region=SimpleNamespace(width=600), preferences=SimpleNamespace(system=system))
    gpu_button.draw(layout, context)
    return layout.drawn


def test_the_preferences_have_the_button():
    assert drawn().buttons == [("imprint.test_gpu", True)]


def test_the_verdict_is_shown(found):
    found(RIGHT)
    assert bpy.ops.imprint.test_gpu() == {"FINISHED"}
    assert last.report is RIGHT
    shown = drawn()
    assert "All 2 tests of this GPU are right." in shown.labels
    names = [name for name, _ in shown.buttons]
    assert names == ["imprint.test_gpu", "imprint.copy_gpu_report", "imprint.save_gpu_report"]


def test_what_is_wrong_is_shown(found):
    found(WRONG)
    bpy.ops.imprint.test_gpu()
    shown = drawn()
    assert "9 of 10 tests of this GPU are wrong: bakes may be, too." in shown.labels
    assert [text for text in shown.labels if text.startswith("Pair")] == [f"Pair {number}: bad" for number in range(6)]
    assert "3 more are in the report." in shown.labels


def test_a_bar_takes_the_place_of_the_button():
    display.show(bpy.context, replace(job.STEP, done=0.5))
    try:
        shown = drawn()
        assert shown.buttons == [("imprint.stop", True)]
        assert any(text.startswith("Testing the GPU, 50%") for text in shown.labels)
        assert not bpy.ops.imprint.test_gpu.poll()
    finally:
        display.hide(bpy.context)


def test_a_bake_has_its_bar_elsewhere():
    display.show(bpy.context, Progress("Drawing", 0.5))
    try:
        assert drawn().buttons == [("imprint.test_gpu", True)]
    finally:
        display.hide(bpy.context)


def test_live_is_stopped_first(monkeypatch):
    monkeypatch.setattr(type(live), "is_on", True)
    assert not bpy.ops.imprint.test_gpu.poll()


def test_without_a_gpu_there_is_one_sentence(found):
    found(NoGpu("Blender has no GPU to draw on here: it is away."))
    assert panel.refusal(bpy.ops.imprint.test_gpu) == "Blender has no GPU to draw on here: it is away."


def test_the_report_is_saved(found, tmp_path):
    found(RIGHT)
    bpy.ops.imprint.test_gpu()
    assert bpy.ops.imprint.save_gpu_report(filepath=str(tmp_path / "gpu")) == {"FINISHED"}
    assert json.loads((tmp_path / "gpu.json").read_text()) == RIGHT.to_dict()


@pytest.mark.parametrize("operator", ["copy_gpu_report", "save_gpu_report"])
def test_without_a_test_there_is_no_report(operator):
    assert panel.refusal(getattr(bpy.ops.imprint, operator)) == "Test the GPU first: press Test My GPU."


def test_a_report_is_not_kept_after_the_add_on():
    last.report = RIGHT
    gpu_button.unregister()
    try:
        assert last.report is None
    finally:
        gpu_button.register()
