# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that cures what is found before a bake."""

import bpy
from bpy.props import EnumProperty, StringProperty

from ...core.errors import BakeError
from ...jobs.readiness import cures
from ...scene import object_refs
from ..translations.lookup import LABEL, tooltip
from ..viewport.progress_display import display

CURES = {
    "POLYGONS": (
        "Triangulate",
        "Add a modifier that divides the faces into the triangles that Blender draws, so that the bake and exporters use the "
        "same ones",
        "MOD_TRIANGULATE",
    ),
    "LAYER": (
        "Activate UV Map",
        "Make the UV map of the bake the active one, whose tangents exporters write",
        "GROUP_UVS",
    ),
    "HARD_EDGES": (
        "Smooth inside Islands",
        "Make hard edges inside UV islands smooth. Those at borders of islands stay hard, and custom normals stay elsewhere",
        "SMOOTHCURVE",
    ),
    "MIRRORED": (
        "Move Mirrored UVs",
        "Move parts that are mirrored onto others in UV space by one tile: they read the same texels, and the map shows the "
        "detail of the others",
        "MOD_MIRROR",
    ),
}
"""Label, tooltip and icon of each cure."""


class IMPRINT_OT_cure(bpy.types.Operator):
    """Change the low object so that other programs show its map as it is baked"""

    bl_idname = "imprint.cure"
    bl_label = "Prepare Low Object"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Cure",
        description="What to change",
        items=[(kind, *texts[:2]) for kind, texts in CURES.items()],
        translation_context=LABEL,
    )
    low: StringProperty(
        name="Low",
        description="Name of the low object; empty for the slot or the active object",
        options={"SKIP_SAVE"},
        translation_context=LABEL,
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return tooltip(CURES[properties.kind][1])

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.imprint
        try:
            low, highs = settings.chosen_objects(context, object_refs.by_name(self.low) if self.low else None)
            if low is None or low.type != "MESH":
                raise BakeError("No low object: select it, or fill the slot.")
            message = cures.cure(context, low, settings.settings_for(low, highs), self.kind, is_own_base=low in highs)
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, message)
        return {"FINISHED"}


CLASSES = (IMPRINT_OT_cure,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
