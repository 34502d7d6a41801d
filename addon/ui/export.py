# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that writes the low object and its maps to a file for an engine."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..core import file_formats, naming
from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..export import engine_files
from ..export.engine_files import Exported
from . import modal, object_pairs
from .bake_results import results
from .callbacks import redraw
from .progress_display import display
from .translations import LABEL, message, tooltip

ENDINGS = ", ".join(file_formats.MESHES)


class IMPRINT_OT_export(modal.SlicedOperator, bpy.types.Operator):
    """Write the low object and the maps of its last bake to a file for an engine, read it back, and compare it with the bake"""

    bl_idname = "imprint.export"
    bl_label = "Export for Engine"

    filepath: StringProperty(
        name="File",
        description="File to write; empty for the one in the panel",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )
    # Blender's file browser takes these two: it lists such files, and warns before it replaces one.
    filter_glob: StringProperty(
        name="File Filter",
        description="Names of the files that the file browser lists",
        default=";".join(f"*{ending}" for ending in file_formats.MESHES),
        options={"HIDDEN", "SKIP_SAVE"},
        translation_context=LABEL,
    )
    check_existing: BoolProperty(
        name="Check Existing",
        description="Warn before a file is replaced",
        default=True,
        options={"HIDDEN", "SKIP_SAVE"},
        translation_context=LABEL,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if results.of(context) is None:
            cls.poll_message_set(tooltip("Bake this low object first"))
            return False
        return display.current is None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.filepath or context.scene.imprint.export:
            return super().invoke(context, event)
        self.filepath = f"{naming.file_name(results.of(context).low)}{file_formats.MESHES[0]}"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, _context: bpy.types.Context) -> None:
        """What the file browser shows beside the files."""
        column = self.layout.column(align=True)
        column.label(text=message("The ending decides the format:"), translate=False)
        column.label(text=ENDINGS, translate=False)

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self.options.is_invoke and context.window is not None:  # the file browser has closed
            bpy.ops.imprint.export("INVOKE_DEFAULT", filepath=self.filepath)
            return {"FINISHED"}
        return super().execute(context)

    def task(self, context: bpy.types.Context, _pace: Pace) -> Task[Exported]:
        reports = results.all_of(context)
        path = naming.fill(self.filepath or context.scene.imprint.export, reports[0].low)
        if not path:
            raise BakeError("No file is set for the export: set one.")
        if path.startswith("//") and not bpy.data.filepath:
            raise BakeError(f"{path!r} is relative to a .blend file that was never saved: save it first.")
        (done,) = yield from engine_files.work(context, [reports], Path(bpy.path.abspath(path)).absolute())
        return done

    def finish(self, context: bpy.types.Context, result: Exported) -> None:
        for warning in result.warnings:
            self.report({"WARNING"}, warning)
        exported = {**result.to_dict(), "warnings": result.warnings}
        reports = [report.with_export(exported) for report in results.all_of(context)]
        object_pairs.keep_reports(reports[0].refs[0].resolve(), reports)
        self.report({"INFO"}, reports[0].exported)
        redraw()


CLASSES = (IMPRINT_OT_export,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
