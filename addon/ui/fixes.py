# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel finds before a bake, and the buttons that fix what findings, warnings and errors name."""

import bpy
from bpy.props import EnumProperty, StringProperty

from ..core import fixes
from ..core.errors import BakeError
from ..core.settings import Settings
from ..jobs import readiness
from ..jobs.readiness import Finding
from ..scene import object_refs
from .callbacks import Handlers
from .modal import QuickOperator
from .progress_display import display
from .sidebar import draw_paragraphs
from .translations import LABEL, label, tooltip


class PanelFindings:
    """The findings for the low object of the panel.

    looks: how often a mesh was looked at. known: what was found the last time, or nothing after a change.
    """

    def __init__(self):
        self.looks = 0
        self._key: tuple | None = None
        self.known: list[Finding] = []
        self._pair: tuple | None = None
        self._flipped: list[Finding] = []
        self._handlers = Handlers(
            ("depsgraph_update_post", self._after_update), ("undo_post", self._drop), ("redo_post", self._drop)
        )

    def of(
        self,
        context: bpy.types.Context,
        low: bpy.types.Object,
        highs: list[bpy.types.Object],
        settings: Settings,
        *,
        is_exported: bool = False,
    ) -> list[Finding]:
        """The findings for a bake of `low`: whether it is flipped, and more if other programs read the map. settings: of the
        panel, valid.

        is_exported: as in readiness.is_for_others.
        """
        found = self._flipped_ones(context, low, highs)
        if not readiness.is_for_others(settings, is_exported=is_exported):
            return found
        return found + readiness.unsolved_by_export(
            self._of(context, low, low in highs, settings), is_exported=is_exported
        )

    def _flipped_ones(
        self, context: bpy.types.Context, low: bpy.types.Object, highs: list[bpy.types.Object]
    ) -> list[Finding]:
        """Whether the faces of high and low point to opposite sides, from the last time if nothing has changed since."""
        key = tuple(
            value
            for obj in (low, *highs)
            for value in (obj.session_uid, obj.data.session_uid if obj.data else 0, obj.name, obj.mode)
        )
        if key != self._pair:
            self._handlers.add()
            self._flipped = readiness.viewport_flipped(context, low, highs)
            self._pair = key
        return self._flipped

    def _of(
        self, context: bpy.types.Context, low: bpy.types.Object, is_own_base: bool, settings: Settings
    ) -> list[Finding]:
        """All findings, from the last time if nothing has changed since."""
        layer = settings.map.uv_layer or readiness.active_layer(low)
        # Names are in the sentences.
        key = (
            *(low.session_uid, low.data.session_uid, low.name, low.mode, is_own_base),
            *(layer, readiness.active_layer(low), settings.sampling.udim),
        )
        if key != self._key:
            self._handlers.add()
            self.looks += 1
            self.known = readiness.viewport_findings(context, low, settings, is_own_base=is_own_base)
            self._key = key
        return self.known

    def forget(self) -> None:
        """Forget the findings, and follow no changes."""
        self._drop()
        self._handlers.remove()

    def _drop(self, *_) -> None:
        self._key, self.known = None, []
        self._pair, self._flipped = None, []

    def _after_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if self._key is None and self._pair is None:
            return
        moved = {update.id.original.session_uid for update in depsgraph.updates if update.is_updated_transform}
        changed = {
            update.id.original.session_uid
            for update in depsgraph.updates
            if update.is_updated_geometry or isinstance(update.id, bpy.types.Mesh)
        }
        if self._pair is not None and not (changed | moved).isdisjoint(self._pair):
            self._pair, self._flipped = None, []
        if self._key is not None and changed.intersection(self._key[:2]):
            self._key, self.known = None, []


findings = PanelFindings()


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
    "MIRRORED": (
        "Move Mirrored UVs",
        "Move parts that are mirrored onto others in UV space by one tile: they read the same texels, and the map shows the "
        "detail of the others",
        "MOD_MIRROR",
    ),
    fixes.AUTO: (
        "Choose Auto",
        "Set Method to Auto, which casts rays where the UV layouts differ",
        "SETTINGS",
    ),
    fixes.CAST: ("Cast Rays", "Set Method to Cast, which needs no UVs of the high mesh", "SETTINGS"),
    fixes.OWN_HIT: (
        "Use Own Hit",
        "Set Hit to Own, which chooses the layer that belongs to each texel",
        "SETTINGS",
    ),
    fixes.MEASURE: (
        "Measure Distances",
        "Measure how far the high surface lies from the low one, instead of using distances that were set",
        "SETTINGS",
    ),
    fixes.DEPTH: ("Use 32 Bits", "Set Depth to 32, which holds larger values", "SETTINGS"),
    fixes.SAMPLES: ("Use 16 Samples", "Set Samples to 16", "SETTINGS"),
    fixes.NO_MATERIAL: (
        "Switch Material Off",
        "Leave the materials of the low object as they are",
        "SETTINGS",
    ),
    fixes.TEXTURE_SETS: (
        "Use Texture Sets",
        "Switch Texture Sets on, which bakes an image for each material of the low object",
        "SETTINGS",
    ),
    fixes.MISS_MASK: (
        "Make Miss Mask",
        "Also make an image that is white where the rays hit nothing",
        "SETTINGS",
    ),
}
"""Label, tooltip and icon of each fix: those of the low object, and those that change a setting."""


class IMPRINT_OT_cure(QuickOperator, bpy.types.Operator):
    """Change what a warning or an error names"""

    bl_idname = "imprint.cure"
    bl_label = "Cure"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Cure",
        description="What to change",
        items=[(kind, *texts[:2]) for kind, texts in FIXES.items()],
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
        return tooltip(FIXES[properties.kind][1])

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None

    def apply(self, context: bpy.types.Context) -> str:
        chosen = context.scene.imprint.chosen(context, object_refs.by_name(self.low) if self.low else None)
        if chosen.low is None or chosen.low.type != "MESH":
            raise BakeError("No low object: select it, or fill the slot.")
        change = fixes.FIXES.get(self.kind)
        if change is None:
            return readiness.fix(context, chosen.low, chosen.highs, chosen.settings, self.kind)
        owner = chosen.rays if change.setting in chosen.rays.bl_rna.properties else chosen.panel
        setattr(owner, change.setting, change.value)
        return f"{owner.bl_rna.properties[change.setting].name}: {FIXES[self.kind][0]}"


def draw_fixable(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str) -> None:
    """A sentence of a report or an error, without what fixes it in a shell, and the button that fixes it."""
    shown, kind = fixes.in_window(text)
    draw_paragraphs(layout, context, [shown], icon)
    if kind:
        draw_button(layout, kind)


def draw_button(layout: bpy.types.UILayout, kind: str) -> None:
    """The button of a kind of FIXES."""
    name, _, icon = FIXES[kind]
    layout.operator("imprint.cure", text=label(name), translate=False, icon=icon).kind = kind


CLASSES = (IMPRINT_OT_cure,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
