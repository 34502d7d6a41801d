# SPDX-License-Identifier: GPL-3.0-or-later
"""The test of the GPU in the add-on's preferences: its button and bar, its verdict, and what to do with the report."""

import json
from functools import partial
from pathlib import Path

import bpy
from bpy.props import StringProperty

from .. import older_blender
from ..core.errors import BakeError
from ..core.gpu_report import GpuReport
from ..core.progress import Pace, Task
from ..jobs import gpu_test
from ..output.atomic_file import replacing
from . import modal
from .live import live
from .modal import FileOperator, QuickOperator, SlicedOperator, file_filter, warning_of_files
from .progress_display import display
from .texts import draw_paragraphs, labeled, message, tooltip

MOST_SHOWN = 6
"""The wrong tests that the preferences show; the report has all."""


class LastTest:
    """What the last test found. report: None without one."""

    def __init__(self):
        self.report: GpuReport | None = None

    def text(self) -> str:
        """The report for people. Raises BakeError without one."""
        return self._found().text

    def json(self) -> str:
        """The report as JSON. Raises BakeError without one."""
        return json.dumps(self._found().to_dict(), indent=2) + "\n"

    def _found(self) -> GpuReport:
        if self.report is None:
            raise BakeError("Test the GPU first: press Test My GPU.")
        return self.report


last = LastTest()


class IMPRINT_OT_test_gpu(SlicedOperator, bpy.types.Operator):
    """Bake small maps of all kinds, check the graphics driver, and measure times, in less than a minute. It changes nothing"""

    bl_idname = "imprint.test_gpu"
    bl_label = "Test My GPU"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if live.is_on:
            cls.poll_message_set(tooltip("Stop Live first: it uses the GPU"))
            return False
        return display.current is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        return older_blender.with_gpu(partial(super().execute, context))

    def task(self, _context: bpy.types.Context, pace: Pace) -> Task[GpuReport]:
        return gpu_test.work(Pace(modal.SLICE, has_picture=False) if pace.has_listener else pace)

    def finish(self, context: bpy.types.Context, result: GpuReport) -> None:
        last.report = result
        if context.window is not None:
            context.window_manager.clipboard = last.text()
        self.report({"WARNING" if result.wrong else "INFO"}, result.verdict)


class IMPRINT_OT_copy_gpu_report(QuickOperator, bpy.types.Operator):
    """Copy the report of the test as text, for an issue. It names the GPU and its driver, and no users or paths"""

    bl_idname = "imprint.copy_gpu_report"
    bl_label = "Copy Report"

    def apply(self, context: bpy.types.Context) -> str:
        context.window_manager.clipboard = last.text()
        return ""


class IMPRINT_OT_save_gpu_report(FileOperator, bpy.types.Operator):
    """Save the report of the test as JSON"""

    bl_idname = "imprint.save_gpu_report"
    bl_label = "Save Report"

    filepath: labeled(
        StringProperty,
        "Report",
        "JSON file to write",
        subtype="FILE_PATH",
        default="imprint-gpu.json",
        options={"SKIP_SAVE"},
    )
    filter_glob: file_filter("*.json")
    check_existing: warning_of_files()

    def apply(self, _context: bpy.types.Context) -> str:
        path = Path(bpy.path.ensure_ext(bpy.path.abspath(self.filepath), ".json")).absolute()
        with replacing(path) as partial_file:
            partial_file.write_text(last.json(), encoding="utf-8")
        return f"Wrote {path}"


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the test: its button or its bar, and what the last one found."""
    column = layout.column()
    step = display.current
    if step is not None and step.what == gpu_test.STEP.what:
        row = column.row()
        row.progress(factor=step.done, text=display.text(), translate=False)
        row.operator("imprint.stop", text="", icon="X")
    else:
        column.operator("imprint.test_gpu", icon="CHECKMARK")
    report = last.report
    if report is None:
        return
    box = column.box()
    draw_paragraphs(box, context, [_verdict(report)], "ERROR" if report.wrong else "CHECKMARK")
    wrong = [each.text for each in report.wrong]
    for text in wrong[:MOST_SHOWN]:
        draw_paragraphs(box, context, [text], "DOT")
    if len(wrong) > MOST_SHOWN:
        draw_paragraphs(box, context, [message("{} more are in the report.").format(len(wrong) - MOST_SHOWN)], "BLANK1")
    draw_paragraphs(box, context, [message("The report is in the clipboard: paste it into an issue.")], "INFO")
    row = box.row()
    row.operator("imprint.copy_gpu_report", icon="COPYDOWN")
    row.operator("imprint.save_gpu_report", icon="FILE_TICK")


def _verdict(report: GpuReport) -> str:
    count = len(report.driver_checks) + len(report.maps)
    if report.wrong:
        return message("{} of {} tests of this GPU are wrong: bakes may be, too.").format(len(report.wrong), count)
    return message("All {} tests of this GPU are right.").format(count)


CLASSES = (IMPRINT_OT_test_gpu, IMPRINT_OT_copy_gpu_report, IMPRINT_OT_save_gpu_report)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()


def unregister() -> None:
    last.report = None
    _unregister()
