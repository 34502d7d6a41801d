# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong and what fixes it: findings before a bake, the checks of a finished bake, the operators that show where they
found something, and the buttons that fix it."""

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty

from ..core.declarations.choices import Modifiers
from ..core.errors import BakeError, Fix, in_window
from ..core.report import Report
from ..core.settings import Settings
from ..jobs import checks
from ..jobs.checks import Finding
from ..scene import evaluation, mesh_elements, poses, reading, render_view
from ..scene.object_checks import ObjectRef, object_by_name
from . import bake_results
from .bake_results import results
from .callbacks import Timer, events, redraw
from .modal import QuickOperator
from .progress_display import display
from .texts import SidebarPanel, draw_paragraphs, label, labeled, message, tooltip

POSE_SECONDS = 0.2
"""Between a change and the measurement of poses for the panel."""
MOST_POSED = 500_000
"""The vertices of a pair up to which the panel measures poses. A bake measures them in any case."""


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
        self._looked: tuple = ()
        self._look: list[str] = []
        self._shown: tuple = ()
        self._notes: list[str] = []
        self._posed: tuple | None = None
        self._poses: list[str] = []
        self._pair_refs: list[ObjectRef] = []
        self._is_measuring = False
        self._timer = Timer(self.measure_poses)
        events.hear(
            depsgraph_update_post=self._after_update, undo_post=self._drop, redo_post=self._drop, end=self.forget
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

        is_exported: as in jobs.checks.is_for_others.
        """
        found = self._flipped_ones(context, low, highs)
        if not settings.tracing.keep_faces:  # the bake turns them over
            found = [each for each in found if not each.values["is_high"]]
        if not checks.is_for_others(settings, is_exported=is_exported):
            return found
        return found + checks.unsolved_by_export(
            self._of(context, low, low in highs, settings), is_exported=is_exported
        )

    def _flipped_ones(
        self, context: bpy.types.Context, low: bpy.types.Object, highs: list[bpy.types.Object]
    ) -> list[Finding]:
        """Whether the faces of high and low point to opposite sides, from the last time if nothing has changed since."""
        key = self._key_of(low, highs)
        if key != self._pair:
            self._flipped = checks.viewport_flipped(context, low, highs)
            self._pair = key
        return self._flipped

    @staticmethod
    def _key_of(low: bpy.types.Object, highs: list[bpy.types.Object]) -> tuple:
        return tuple(
            value
            for obj in (low, *highs)
            for value in (obj.session_uid, obj.data.session_uid if obj.data else 0, obj.name, obj.mode)
        )

    def material_notes(self, low: bpy.types.Object, highs: list[bpy.types.Object], settings: Settings) -> list[str]:
        """What the maps will not have of the high objects' materials, from the last time if nothing has changed since."""
        slots = (slot.material for high in highs for slot in high.material_slots)
        key = (
            *self._key_of(low, highs),
            settings.map.drawn_maps,
            settings.map.exact_materials,
            *((material.session_uid, material.name) for material in slots if material is not None),
        )
        if key != self._shown:
            self._notes = checks.viewport_material_notes(low, highs, settings.map)
            self._shown = key
        return self._notes

    def pose_notes(
        self, context: bpy.types.Context, low: bpy.types.Object, highs: list[bpy.types.Object], settings: Settings
    ) -> list[str]:
        """What only one of the objects is moved by, in sentences, as it was measured last. A panel may not measure it while
        it is drawn: that is done soon after."""
        for_render = settings.map.modifiers == Modifiers.RENDER
        if settings.map.rest_pose or not poses.may_differ(low, highs, for_render=for_render):
            return []
        key = (*self._key_of(low, highs), for_render)
        if key != self._posed:
            self._posed, self._poses = key, []
            self._pair_refs = [ObjectRef.of(obj) for obj in (low, *highs)]
            self._timer.start(POSE_SECONDS)
        return self._poses

    def measure_poses(self) -> None:
        """Measure what `pose_notes` returns, unless objects have changed since, or other work is under way."""
        if self._posed is None:
            return
        found, for_render = [ref.find() for ref in self._pair_refs], self._posed[-1]
        if render_view.is_busy():  # then it is measured later
            self._posed = None
            return
        screen = bpy.context.screen
        is_busy = display.current is not None or (screen is not None and screen.is_animation_playing)
        if None in found or is_busy or any(obj.mode != "OBJECT" for obj in found):
            return
        if sum(len(obj.data.vertices) for obj in found if obj.type == "MESH") > MOST_POSED:
            return
        self._is_measuring = True
        try:
            self._poses = poses.notes(bpy.context, found[0], found[1:], for_render=for_render)
        finally:
            self._is_measuring = False
        redraw()

    def keep_look(self, low: bpy.types.Object, highs: list[bpy.types.Object], lines: list[str]) -> None:
        """Remember what a look at the high objects found, until one of the objects changes."""
        self._looked, self._look = self._key_of(low, highs), lines

    def look_of(self, low: bpy.types.Object, highs: list[bpy.types.Object]) -> list[str]:
        """What the last look at these objects found; empty without one."""
        return self._look if self._looked and self._looked == self._key_of(low, highs) else []

    def _of(
        self, context: bpy.types.Context, low: bpy.types.Object, is_own_base: bool, settings: Settings
    ) -> list[Finding]:
        """All findings, from the last time if nothing has changed since."""
        layer = settings.map.uv_layer or checks.active_layer(low)
        # Names are in the sentences.
        key = (
            *(low.session_uid, low.data.session_uid, low.name, low.mode, is_own_base),
            *(layer, checks.active_layer(low), settings.sampling.udim),
        )
        if key != self._key:
            self.looks += 1
            self.known = checks.viewport_findings(context, low, settings, is_own_base=is_own_base)
            self._key = key
        return self.known

    def forget(self) -> None:
        """Forget the findings."""
        self._drop()
        self._timer.stop()

    def _drop(self, *_) -> None:
        self._key, self.known = None, []
        self._pair, self._flipped = None, []
        self._looked, self._look = (), []
        self._shown, self._notes = (), []
        if not self._is_measuring:
            self._posed, self._poses = None, []

    def _after_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if self._shown and any(
            isinstance(update.id, (bpy.types.Material, bpy.types.NodeTree)) for update in depsgraph.updates
        ):
            self._shown, self._notes = (), []
        if self._is_measuring or (
            self._key is None and self._pair is None and self._posed is None and not self._looked
        ):
            return
        moved = {update.id.original.session_uid for update in depsgraph.updates if update.is_updated_transform}
        changed = {
            update.id.original.session_uid
            for update in depsgraph.updates
            if update.is_updated_geometry or isinstance(update.id, bpy.types.Mesh)
        }
        if self._pair is not None and not (changed | moved).isdisjoint(self._pair):
            self._pair, self._flipped = None, []
        if self._posed is not None and not (changed | moved).isdisjoint(self._posed):
            self._posed, self._poses = None, []
        if not (changed | moved).isdisjoint(self._looked):
            self._looked, self._look = (), []
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
    checks.UNWRAP: (
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
}
"""Label, tooltip and icon of each fix: those of the low object, and those that change a setting."""


class IMPRINT_OT_cure(QuickOperator, bpy.types.Operator):
    """Change what a warning or an error names"""

    bl_idname = "imprint.cure"
    bl_label = "Cure"
    bl_options = {"REGISTER", "UNDO"}

    kind: labeled(EnumProperty, "Cure", "What to change", items=[(kind, *texts[:2]) for kind, texts in FIXES.items()])
    low: labeled(
        StringProperty, "Low", "Name of the low object; empty for the slot or the active object", options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return tooltip(FIXES[properties.kind][1])

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None

    def apply(self, context: bpy.types.Context) -> str:
        chosen = context.scene.imprint.chosen(context, object_by_name(self.low) if self.low else None)
        if chosen.low is None or chosen.low.type != "MESH":
            raise BakeError("No low object: select it, or fill the slot.")
        change = Fix.__members__.get(self.kind)
        if change is None:
            return checks.fix(context, chosen.low, chosen.highs, chosen.settings, self.kind)
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
    """A sentence of a report or an error, without what fixes it in a shell, and the button that fixes it. low: the name of the
    low object; empty for that of the panel."""
    shown, kind = in_window(text)
    draw_paragraphs(layout, context, [shown], icon)
    if kind:
        draw_button(layout, kind, low)


def draw_button(layout: bpy.types.UILayout, kind: str, low: str = "") -> None:
    """The button of a kind of FIXES."""
    name, _, icon = FIXES[kind]
    button = layout.operator("imprint.cure", text=label(name), translate=False, icon=icon)
    button.kind, button.low = kind, low


CHECKS = {
    "overlap": (
        "Overlapping UVs",
        "Texels that two or more triangles of the low mesh share: they show only one of them. Parts at exactly the same "
        "place, such as mirrored halves, share their detail on purpose and do no harm in tangent space",
    ),
    "uncovered": ("Uncovered", "Texels of the low mesh that no high triangle covers, or whose ray hit nothing"),
    "far": ("Far", "Texels whose points on the low and the high mesh are farther apart than the limit"),
    "unsure": (
        "Unsure layers",
        "Texels that may show the wrong layer of the high mesh: their rays hit several layers, and the low mesh does not tell "
        "which of them belongs to the texel",
    ),
    "gaps": (
        "Close islands",
        "Texels so close to another UV island, or to the border of the map, that the smaller mip levels mix them. Clean "
        "Mips, below the margin, sets the number of levels",
    ),
    "backwards": (
        "Z below 0",
        "Texels whose tangent-space normal points into the surface: lost by programs that read x and y and rebuild z",
    ),
    "mirrored": (
        "Mirrored UVs",
        "Triangles that are mirrored in UV space: common practice, which the target program must support",
    ),
    "outside": (
        "Outside the tile",
        "Triangles that reach outside the UV tile, or the UDIM tiles, and are cut off there. Parts that "
        "were moved by whole tiles, such as mirrored halves, do no harm",
    ),
    "no_area": ("Zero-area UVs", "Triangles without area in UV space, which cannot be drawn"),
    "hard_edges": (
        "Hard edges, no seam",
        "Hard edges inside a UV island: each shows as a line in tangent space. Mark a seam there and unwrap, or shade "
        "smooth",
    ),
    "behind": (
        "Normals behind",
        "Triangles with a shading normal that points behind them, where no tangent-space map can be right",
    ),
    "polygons": (
        "Quads, n-gons",
        "Faces with more than three corners: an exporter may divide them into other triangles",
    ),
    "uneven": ("Non-planar faces", "Quads and n-gons whose shape depends on how they are divided into triangles"),
}
"""Label and tooltip of each check."""

REASONS = {
    "undecided": "No own hit: {}",
    "backs": "Only backs: {}",
    "contested": "Two own hits: {}",
    "jumps": "Jumps: {}",
    "other_layer": "Not the own hit: {}",
    "covered": "Another surface below: {}",
    "beyond": "Another surface beyond the rays: {}",
}
"""Messages with the share of texels that are unsure for each reason, by the keys of the report."""


def _items(kinds: tuple[str, ...]) -> list[tuple[str, str, str]]:
    return [(kind.upper(), *CHECKS[kind]) for kind in kinds]


class _LastBakeOperator(QuickOperator):
    """An operator on the low object of the last bake."""

    low: labeled(
        StringProperty,
        "Low",
        "Name of a low object that was baked; empty for that of the panel, or else the last one",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.has_any(context) and display.current is None

    def last_bake(self, context: bpy.types.Context) -> Report:
        """The report of the bake. Raises BakeError if there is none."""
        report = results.named(context, self.low)
        if report is None:
            raise BakeError(f"Nothing was baked onto {self.low!r}.")
        return report


class IMPRINT_OT_select_flaws(_LastBakeOperator, bpy.types.Operator):
    """Select the faces of the low object that the check has found, in Edit Mode"""

    bl_idname = "imprint.select_flaws"
    bl_label = "Select Faces"
    bl_options = {"REGISTER", "UNDO"}

    kind: labeled(EnumProperty, "Check", "The check whose faces to select", items=_items(checks.KINDS))

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{tooltip(CHECKS[properties.kind.lower()][1])}. {tooltip('Select the faces in Edit Mode')}"

    def apply(self, context: bpy.types.Context) -> str:
        report = self.last_bake(context)
        low, kind = checks.of_low(report), self.kind.lower()
        problem = _selection_problem(low)
        if problem:
            raise BakeError(problem)
        found, is_edge = checks.find(context, report, kind), kind in checks.ON_EDGES
        which = "edge" if is_edge else "face"
        if not len(found):
            raise BakeError(f"No {which} of {low.name!r} has this issue: {CHECKS[kind][0].lower()}.")
        _select(context, low, found, "EDGE" if is_edge else "FACE")
        if self.options.is_invoke and context.window is not None:
            bake_results.show_selection(context)
        many = len(found) > 1
        return f"{len(found):,} {which}{'s' if many else ''} of {low.name!r} {'are' if many else 'is'} selected"


def _selection_problem(obj: bpy.types.Object) -> str:
    """Why faces of `obj` cannot be selected, as a sentence; empty if they can."""
    if not (obj.is_editable and obj.data.is_editable):
        return f"{obj.name!r} is linked from another file: make it local, so that its faces can be selected."
    if not evaluation.is_visible(obj):
        return f"{obj.name!r} is hidden: show it, so that its faces can be selected."
    return ""


def _select(context: bpy.types.Context, obj: bpy.types.Object, chosen: np.ndarray, domain: str = "FACE") -> None:
    """Enter Edit Mode with only `obj`, and select only the faces with the `chosen` indices; edges for the domain "EDGE"."""
    layer = context.view_layer
    _leave_mode(layer.objects.active)
    for other in layer.objects.selected:
        other.select_set(False)
    layer.objects.active = obj
    obj.select_set(True)
    _leave_mode(obj)
    for name, indices in mesh_elements.elements(obj.data, chosen, domain).items():
        part = getattr(obj.data, name)
        flags = np.zeros(len(part), bool)
        flags[indices] = True
        part.foreach_set("select", flags)
        hidden = np.empty_like(flags)
        part.foreach_get("hide", hidden)
        if (hidden & flags).any():  # hidden elements are not visible and do not stay selected
            part.foreach_set("hide", hidden & ~flags)
    obj.data.update_tag()
    context.tool_settings.mesh_select_mode = (False, domain == "EDGE", domain == "FACE")
    # In Edit Mode, the first Undo only leaves the mode. The changes above need their own undo step.
    bpy.ops.ed.undo_push(message="Select Faces")
    bpy.ops.object.mode_set(mode="EDIT")


def _leave_mode(active: bpy.types.Object | None) -> None:
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


class IMPRINT_OT_show_mask(_LastBakeOperator, bpy.types.Operator):
    """Make an image that is white on the texels that the check has found"""

    bl_idname = "imprint.show_mask"
    bl_label = "Show Mask"
    bl_options = {"REGISTER", "UNDO"}

    kind: labeled(EnumProperty, "Check", "The check whose texels to show", items=_items(checks.ON_TEXELS))

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{tooltip(CHECKS[properties.kind.lower()][1])}. {tooltip('Show them white in an image')}"

    def apply(self, context: bpy.types.Context) -> str:
        image = checks.draw_mask(context, self.last_bake(context), self.kind.lower())
        is_pressed = self.options.is_invoke and context.window is not None
        show = bake_results.show_image_beside if is_pressed else bake_results.show_image
        show(context, image)
        return f"The mask is in the image {image.name!r}"


class IMPRINT_OT_add_triangulate(_LastBakeOperator, bpy.types.Operator):
    """Add a modifier that divides the low object's faces into the triangles that were baked, so that exporters use the same"""

    bl_idname = "imprint.add_triangulate"
    bl_label = "Add Triangulate"
    bl_options = {"REGISTER", "UNDO"}

    def apply(self, context: bpy.types.Context) -> str:
        report = self.last_bake(context)
        return checks.triangulate_sentence(report.low, *checks.add_triangulate(context, report))


class IMPRINT_OT_look_at_high(QuickOperator, bpy.types.Operator):
    """Say what the high objects are before a bake: parts, faces to turn over or leave out, noise, distance to the low object"""

    bl_idname = "imprint.look_at_high"
    bl_label = "Look at High"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return display.current is None

    def apply(self, context: bpy.types.Context) -> str:
        chosen = context.scene.imprint.chosen(context)
        job, settings = chosen.job(context)
        lines = checks.look_at_high(context, job, settings).lines(reading.lengths_of(context.scene))
        findings.keep_look(chosen.low, chosen.highs, lines)
        return ". ".join(lines)


ICONS = {"GOOD": ("CHECKMARK", 0), "LOOK": ("INFO", 1), "WRONG": ("ERROR", 2)}
"""Icon of each severity, and its rank."""


class IMPRINT_PT_checks(SidebarPanel, bpy.types.Panel):
    """The findings of the checks in the last bake."""

    bl_idname = "IMPRINT_PT_checks"
    bl_parent_id = "IMPRINT_PT_results"
    bl_label = "Checks"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return results.of(context) is not None

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        report = results.of(context)
        if report is not None:
            worst = max(report.checks.values(), key=lambda check: ICONS[_severity(check)][1], default={})
            self.layout.label(text="", icon=ICONS[_severity(worst)][0])

    def draw(self, context: bpy.types.Context) -> None:
        layout, report = self.layout, results.of(context)
        column = layout.column(align=True)
        for kind in CHECKS:
            _draw_row(column, kind, report.checks[kind], report.low, context)
        row = layout.row()
        row.enabled = report.checks["polygons"]["count"] > 0
        row.operator("imprint.add_triangulate", icon="MOD_TRIANGULATE").low = report.low


def _draw_row(column: bpy.types.UILayout, kind: str, check: dict, low: str, context: bpy.types.Context) -> None:
    """A check in a row: its icon, name and number, and the buttons that show where its findings are."""
    row = column.row(align=True)
    row.label(text=label(CHECKS[kind][0]), icon=ICONS[_severity(check)][0], translate=False)
    number = row.row()
    number.alignment = "RIGHT"
    number.label(text=_number(check), translate=False)
    buttons = row.row(align=True)
    buttons.enabled = check["count"] > 0
    for operator, icon, kinds in (
        ("imprint.show_mask", "IMAGE_DATA", checks.ON_TEXELS),
        ("imprint.select_flaws", "RESTRICT_SELECT_OFF", checks.KINDS),
    ):
        if kind in kinds:
            button = buttons.operator(operator, text="", icon=icon)
            button.kind, button.low = kind.upper(), low
        else:
            buttons.label(text="", icon="BLANK1")  # keeps the other buttons in their columns
    if "maximum" in check and check["count"]:
        far = map(reading.lengths_of(context.scene), (check["limit"], check["percentile_99"], check["maximum"]))
        text = message("Over {}; 99 % within {}, at most {}").format(*far)
        draw_paragraphs(column, context, [text], "BLANK1")
    if kind == "unsure" and check["count"]:
        found = [message(text).format(_share(check, key)) for key, text in REASONS.items() if check[key]]
        draw_paragraphs(column, context, ["; ".join(found)], "BLANK1")
    if check.get("islands"):
        text = message("UV islands: {}").format(f"{check['islands']:,}")
        column.label(text=text, icon="BLANK1", translate=False)


def _severity(check: dict) -> str:
    """One of ICONS: the rating of the audit or, without a rating, whether there is a finding."""
    return check.get("severity") or ("LOOK" if check.get("count") else "GOOD")


def _number(check: dict) -> str:
    """A check's number in a few characters."""
    return _share(check, "count") if "share" in check else f"{check['count']:,}"


def _share(check: dict, key: str) -> str:
    """The share of the texels that a check's number `key` counts."""
    share = check[key] / max(1, check["of"])
    return f"{share:.1%}" if share >= 0.001 or not check[key] else "< 0.1%"


CLASSES = (
    IMPRINT_OT_look_at_high,
    IMPRINT_OT_cure,
    IMPRINT_OT_select_flaws,
    IMPRINT_OT_show_mask,
    IMPRINT_OT_add_triangulate,
    IMPRINT_PT_checks,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
