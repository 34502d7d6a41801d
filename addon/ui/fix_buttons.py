# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences with their signs, and the buttons that fix what they name."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ..core.declarations.choices import Storage
from ..core.errors import PACKS, UNWRAPS, BakeError, Fix, in_window, shorten_list
from ..core.progress import Pace, Task
from ..core.sentences import LOOK, NOTE, RANKS, WRONG, Harm, Sentence, gist
from ..core.settings import Settings
from ..jobs import fixes
from ..scene.object_checks import object_by_name
from . import sets
from .callbacks import registering
from .modal import QuickOperator, SlicedOperator, WaitingOperator
from .progress_display import display
from .properties import Chosen
from .texts import draw_paragraphs, label, labeled, message, tooltip

ICONS = {WRONG: "ERROR", LOOK: "INFO", NOTE: "BLANK1"}
"""The sign of each severity, everywhere."""
RIGHT = "CHECKMARK"
"""That of what is right."""
SIGNS = (ICONS[WRONG], ICONS[LOOK], RIGHT)
"""Those of rows, from the worst."""

MOST_SHOWN = 3
"""Sentences of a list that are not behind a fold."""

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
    Fix.BC7.name: ("Use BC7", "Set Compression to BC7, which stores the sign of z", "SETTINGS"),
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


class _OfLows:
    """The low objects of a button."""

    low: labeled(
        StringProperty, "Low", "Name of the low object; empty for the slot or the active object", options={"SKIP_SAVE"}
    )
    lows: labeled(
        StringProperty, "Low Objects", "Names of low objects that need the same, in JSON", options={"SKIP_SAVE"}
    )

    @property
    def names(self) -> list[str]:
        """Their names; an empty one for that of the panel."""
        return json.loads(self.lows) if self.lows else [self.low]


def _chosen(context: bpy.types.Context, name: str) -> Chosen:
    """The low object of a name, or that of the panel, with what belongs to it. Raises BakeError."""
    chosen = context.scene.imprint.chosen(context, object_by_name(name) if name else None)
    if chosen.low is None or chosen.low.type != "MESH":
        raise BakeError("No low object: select it, or fill the slot.")
    return chosen


def _settings(context: bpy.types.Context, chosen: Chosen) -> Settings:
    one = sets.active(context)
    return one.settings if one is not None else chosen.settings


class IMPRINT_OT_unwrap(WaitingOperator, SlicedOperator, _OfLows, bpy.types.Operator):
    """Give the low object a UV map: unwrap it in several ways, with the margin that Clean Mips needs, and keep the best"""

    bl_idname = "imprint.unwrap"
    bl_label = "Unwrap"
    bl_options = {"REGISTER", "UNDO"}

    def task(self, context: bpy.types.Context, pace: Pace) -> Task[tuple[list[str], list[str]]]:
        all_chosen = [_chosen(context, name) for name in self.names]
        lows = [(chosen.low, _settings(context, chosen)) for chosen in all_chosen]
        panel = context.scene.imprint
        group = panel.asset_density_group
        return (yield from fixes.unwrap(lows, stacks=panel.asset_stack_mirrored, density_group=group))

    def finish(self, context: bpy.types.Context, result: tuple[list[str], list[str]]) -> None:
        done, failures = result
        for text in failures:
            self.report({"WARNING"}, text)
        self.report({"INFO"}, shorten_list(done, 1))


class IMPRINT_OT_fix(WaitingOperator, QuickOperator, _OfLows, bpy.types.Operator):
    """Change what a warning or an error names"""

    bl_idname = "imprint.fix"
    bl_label = "Fix"
    bl_options = {"REGISTER", "UNDO"}

    kind: labeled(EnumProperty, "Fix", "What to change", items=[(kind, *texts[:2]) for kind, texts in FIXES.items()])

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return tooltip(FIXES[properties.kind][1])

    def apply(self, context: bpy.types.Context) -> str:
        names, done, failures = self.names, [], []
        for name in names:
            try:
                done.append(self._fix(context, name, is_alone=len(names) == 1))
            except BakeError as error:
                failures.append(str(error))
        if not done:
            raise BakeError(failures[0])
        for text in failures:
            self.report({"WARNING"}, text)
        return shorten_list(dict.fromkeys(done), 1)

    def _fix(self, context: bpy.types.Context, name: str, *, is_alone: bool) -> str:
        """Fix one low object. name: empty for that of the panel. Returns what was done. Raises BakeError."""
        chosen = _chosen(context, name)
        change, one = Fix.__members__.get(self.kind), sets.active(context)
        if change is None:
            return fixes.fix(context, chosen.low, chosen.highs, _settings(context, chosen), self.kind)
        if change is Fix.UDIM:
            storing = sets.owner(context, "storage")
            if storing.storage == Storage.MEMORY:  # which holds one tile
                storing.storage = Storage.PACK
        is_of_pair = one is None and change.setting in chosen.rays.bl_rna.properties
        owner = chosen.rays if is_of_pair else sets.owner(context, change.setting)
        setattr(owner, change.setting, change.new_value)
        if change is Fix.REST_POSE and is_alone and one is None:
            return self._bake(chosen.low)
        return f"{owner.bl_rna.properties[change.setting].name}: {FIXES[self.kind][0]}"

    def _bake(self, low: bpy.types.Object) -> str:
        """Bake the pair of a low object. Raises BakeError."""
        try:
            bpy.ops.imprint.bake("INVOKE_DEFAULT" if self.options.is_invoke else "EXEC_DEFAULT", low=low.name)
        except RuntimeError as error:  # what the operator has reported
            raise BakeError(str(error).removeprefix("Error: ").strip()) from error
        return ""


@dataclass(frozen=True)
class Told:
    """A sentence as panels show it.

    Attributes:
        text: In the language of the interface, without what fixes it in a shell.
        harm: How much it tells of.
        kind, share: What it is about, and of how much, as Sentence has them.
        fixes: Its buttons: keys of FIXES, or fixes.UNWRAP or fixes.PACK.
        lows: The names of the low objects that it is true of; empty for that of the panel.
    """

    text: str
    harm: Harm
    kind: str = ""
    share: float = 0.0
    fixes: tuple[str, ...] = ()
    lows: tuple[str, ...] = ()

    @classmethod
    def of(cls, sentence: str) -> "Told":
        """A sentence of a report, a check or an error."""
        sentence = Sentence.of(sentence)
        text, fix = in_window(sentence)
        kinds = filter(
            None, (fixes.UNWRAP if UNWRAPS in sentence else "", fixes.PACK if PACKS in sentence else "", fix)
        )
        return cls(message(text), sentence.harm, sentence.kind, sentence.share, tuple(kinds))

    @property
    def rank(self) -> tuple[int, float]:
        """Its place in a list, from the worst."""
        return RANKS[self.harm], -self.share


def grouped(found: Iterable[tuple[str, Told]]) -> list[Told]:
    """Sentences with the names of their low objects, which may be empty: those that say the same are one, the worst first."""
    groups: dict[tuple, list[tuple[str, Told]]] = {}
    for low, told in found:
        groups.setdefault((told.harm, gist(told.text), told.fixes), []).append((low, told))
    joined = []
    for group in groups.values():
        worst = min((told for _, told in group), key=lambda each: each.rank)
        count = len({low or told.text for low, told in group})
        text = message("In {} low objects: {}").format(count, worst.text) if count > 1 else worst.text
        lows = tuple(dict.fromkeys(low for low, _ in group if low))
        joined.append((-count, replace(worst, text=text, lows=lows)))
    return [told for _, told in sorted(joined, key=lambda each: (RANKS[each[1].harm], each[0], -each[1].share))]


def draw_told(
    layout: bpy.types.UILayout, context: bpy.types.Context, told: Told, *, is_below_row: bool = False
) -> None:
    """A sentence with its sign, and its buttons. is_below_row: whether a row above it has the sign."""
    draw_paragraphs(layout, context, [told.text], "BLANK1" if is_below_row else ICONS[told.harm])
    for kind in told.fixes:
        draw_button(layout, kind, *told.lows)


def draw_list(layout: bpy.types.UILayout, context: bpy.types.Context, told: Sequence[Told]) -> None:
    """Sentences, sorted: the worst ones, and behind a fold the others."""
    manager = context.window_manager
    shown = told if manager.imprint_shows_all else told[:MOST_SHOWN]
    for each in shown:
        draw_told(layout, context, each)
    if len(told) > MOST_SHOWN:
        row = layout.row()
        row.alignment = "LEFT"
        text = message("And {} more").format(len(told) - MOST_SHOWN)
        icon = "DISCLOSURE_TRI_DOWN" if manager.imprint_shows_all else "DISCLOSURE_TRI_RIGHT"
        row.prop(manager, "imprint_shows_all", text=text, translate=False, icon=icon, emboss=False)


def draw_fixable(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str, low: str = "") -> None:
    """A sentence of a report or an error, without what fixes it in a shell, and the buttons that fix it. low: the name of the
    low object; empty for that of the panel."""
    told = Told.of(text)
    draw_paragraphs(layout, context, [told.text], icon)
    for kind in told.fixes:
        draw_button(layout, kind, *filter(None, [low]))


def draw_button(layout: bpy.types.UILayout, kind: str, *lows: str) -> None:
    """The button of a kind of FIXES, or that of fixes.UNWRAP or fixes.PACK, or a bar in its place. lows: the names of the low
    objects that it is for; none for that of the panel."""
    if kind == fixes.PACK:
        draw_packing(layout, selected=sets.active(bpy.context) is None)
        return
    if kind == fixes.UNWRAP:
        button = display.draw_operator(layout, "imprint.unwrap", icon="UV")
        if button is None:
            return
    else:
        name, _, icon = FIXES[kind]
        button = layout.operator("imprint.fix", text=label(name), translate=False, icon=icon)
        button.kind = kind
    button.low, button.lows = (lows[0] if len(lows) == 1 else ""), (json.dumps(lows) if len(lows) > 1 else "")


def draw_packing(layout: bpy.types.UILayout, *, selected: bool = False) -> None:
    """The button that packs UV maps, or a bar in its place. selected: whether those of the selected objects."""
    button = display.draw_operator(layout, "imprint.pack_uvs", icon="GROUP_UVS")
    if button is not None:
        button.selected = selected


CLASSES = (IMPRINT_OT_unwrap, IMPRINT_OT_fix)
register, unregister = registering(
    CLASSES,
    properties={
        "WindowManager.imprint_shows_all": labeled(
            BoolProperty, "Show All", "Show all that is known of the bake, not only the worst", options={"SKIP_SAVE"}
        )
    },
)
