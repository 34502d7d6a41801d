# SPDX-License-Identifier: GPL-3.0-or-later
"""The buttons that fix what a warning, an error or a finding names."""

import bpy
from bpy.props import EnumProperty, StringProperty

from ..core.declarations.choices import Storage
from ..core.errors import UNWRAPS, BakeError, Fix, in_window
from ..jobs import fixes
from ..scene.object_checks import object_by_name
from .modal import QuickOperator, WaitingOperator
from .texts import draw_paragraphs, label, labeled, tooltip

FIXES = {
    "FLIPPED": (
        "Flip Normals",
        "Flip the faces of the object that point to the wrong side",
        "NORMALS_FACE",
    ),
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
    fixes.UNWRAP: (
        "Unwrap",
        "Give the low object a UV map: unwrap it in several ways, pack the islands with the margin that Clean Mips needs, and "
        "keep the sharpest",
        "UV",
    ),
    "MIRRORED": (
        "Move Mirrored UVs",
        "Move parts that are mirrored onto others in UV space by one tile: they read the same texels, and the map shows the "
        "detail of the others",
        "MOD_MIRROR",
    ),
    Fix.AUTO.name: (
        "Choose Auto",
        "Set Method to Auto, which casts rays where the UV layouts differ",
        "SETTINGS",
    ),
    Fix.CAST.name: ("Cast Rays", "Set Method to Cast, which needs no UVs of the high mesh", "SETTINGS"),
    Fix.OWN_HIT.name: (
        "Use Own Hit",
        "Set Hit to Own, which chooses the layer that belongs to each texel",
        "SETTINGS",
    ),
    Fix.MEASURE.name: (
        "Measure Distances",
        "Measure how far the high surface lies from the low one, instead of using distances that were set",
        "SETTINGS",
    ),
    Fix.DEPTH.name: ("Use 32 Bits", "Set Depth to 32, which holds larger values", "SETTINGS"),
    Fix.SAMPLES.name: ("Use 16 Samples", "Set Samples to 16", "SETTINGS"),
    Fix.NO_MATERIAL.name: (
        "Switch Material Off",
        "Leave the materials of the low object as they are",
        "SETTINGS",
    ),
    Fix.TEXTURE_SETS.name: (
        "Use Texture Sets",
        "Switch Texture Sets on, which bakes an image for each material of the low object",
        "SETTINGS",
    ),
    Fix.MISS_MASK.name: (
        "Make Miss Mask",
        "Also make an image that is white where the rays hit nothing",
        "SETTINGS",
    ),
    Fix.REST_POSE.name: (
        "Bake in Rest Pose",
        "Set Rest Pose, which bakes without the deformers that only one of the objects has, and bake",
        "ARMATURE_DATA",
    ),
    Fix.UDIM.name: (
        "Bake UDIM Tiles",
        "Switch UDIM Tiles on, which bakes a map for each tile that the low mesh covers",
        "UV_DATA",
    ),
}
"""Label, tooltip and icon of each fix: those of the low object, and those that change a setting."""


class IMPRINT_OT_fix(WaitingOperator, QuickOperator, bpy.types.Operator):
    """Change what a warning or an error names"""

    bl_idname = "imprint.fix"
    bl_label = "Fix"
    bl_options = {"REGISTER", "UNDO"}

    kind: labeled(EnumProperty, "Fix", "What to change", items=[(kind, *texts[:2]) for kind, texts in FIXES.items()])
    low: labeled(
        StringProperty, "Low", "Name of the low object; empty for the slot or the active object", options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return tooltip(FIXES[properties.kind][1])

    def apply(self, context: bpy.types.Context) -> str:
        chosen = context.scene.imprint.chosen(context, object_by_name(self.low) if self.low else None)
        if chosen.low is None or chosen.low.type != "MESH":
            raise BakeError("No low object: select it, or fill the slot.")
        change = Fix.__members__.get(self.kind)
        if change is None:
            return fixes.fix(context, chosen.low, chosen.highs, chosen.settings, self.kind)
        if change is Fix.UDIM and chosen.panel.storage == Storage.MEMORY:  # which holds one tile
            chosen.panel.storage = Storage.PACK
        owner = chosen.rays if change.setting in chosen.rays.bl_rna.properties else chosen.panel
        setattr(owner, change.setting, change.new_value)
        if change is Fix.REST_POSE:
            return self._bake(chosen.low)
        return f"{owner.bl_rna.properties[change.setting].name}: {FIXES[self.kind][0]}"

    def _bake(self, low: bpy.types.Object) -> str:
        """Bake the pair of a low object. Raises BakeError."""
        try:
            bpy.ops.imprint.bake("INVOKE_DEFAULT" if self.options.is_invoke else "EXEC_DEFAULT", low=low.name)
        except RuntimeError as error:  # what the operator has reported
            raise BakeError(str(error).removeprefix("Error: ").strip()) from error
        return ""


def draw_fixable(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str, low: str = "") -> None:
    """A sentence of a report or an error, without what fixes it in a shell, and the buttons that fix it. low: the name of the
    low object; empty for that of the panel."""
    shown, kind = in_window(text)
    draw_paragraphs(layout, context, [shown], icon)
    for each in filter(None, (fixes.UNWRAP if UNWRAPS in text else "", kind)):
        draw_button(layout, each, low)


def draw_button(layout: bpy.types.UILayout, kind: str, low: str = "") -> None:
    """The button of a kind of FIXES."""
    name, _, icon = FIXES[kind]
    button = layout.operator("imprint.fix", text=label(name), translate=False, icon=icon)
    button.kind, button.low = kind, low


CLASSES = (IMPRINT_OT_fix,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
