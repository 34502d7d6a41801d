# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that sends a job file to a render farm."""

from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty

from ...core.errors import BakeError
from ...farms import flamenco
from ..translations import LABEL, tooltip
from . import farm_preferences


class IMPRINT_OT_send_to_flamenco(bpy.types.Operator):
    """Send a job file to the Flamenco Manager in the add-on's preferences. All its machines must see the file"""

    bl_idname = "imprint.send_to_flamenco"
    bl_label = "Send to Flamenco"

    filepath: StringProperty(
        name="Job File",
        description="Job file with the bakes, .toml or .json",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )
    filter_glob: StringProperty(
        name="File Filter",
        description="Names of the files that the file browser lists",
        default="*.toml;*.json",
        options={"HIDDEN", "SKIP_SAVE"},
        translation_context=LABEL,
    )
    shards: IntProperty(
        name="Parts",
        description="Number of parts of about the same cost, each a task",
        default=16,
        min=1,
        max=1000,
        translation_context=LABEL,
    )

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not bpy.app.online_access:
            cls.poll_message_set(tooltip("Allow online access in Blender's preferences first"))
            return False
        return True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath)).absolute()
        job = flamenco.Job(path.stem, {"jobs": str(path), "shards": self.shards})
        try:
            if not path.is_file():
                raise BakeError(f"There is no file {str(path)!r}: choose a job file.")
            page = flamenco.submit(farm_preferences.flamenco_address(context), job)
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Sent: {page}")
        return {"FINISHED"}


CLASSES = (IMPRINT_OT_send_to_flamenco,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
