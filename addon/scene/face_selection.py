# SPDX-License-Identifier: GPL-3.0-or-later
"""Selects faces or edges of an object in Edit Mode, to show them to the user."""

import bpy
import numpy as np

from . import evaluation, mesh_elements


def problem(obj: bpy.types.Object) -> str:
    """Why faces of `obj` cannot be selected, as a sentence; empty if they can."""
    if not (obj.is_editable and obj.data.is_editable):
        return f"{obj.name!r} is linked from another file: make it local, so that its faces can be selected."
    if not evaluation.is_visible(obj):
        return f"{obj.name!r} is hidden: show it, so that its faces can be selected."
    return ""


def select(context: bpy.types.Context, obj: bpy.types.Object, chosen: np.ndarray, domain: str = "FACE") -> None:
    """Enter Edit Mode with only `obj`, and select only the faces with the `chosen` indices; edges for the domain "EDGE"."""
    layer = context.view_layer
    _leave_mode(layer.objects.active)
    for other in layer.objects.selected:
        other.select_set(False)
    layer.objects.active = obj
    obj.select_set(True)
    _leave_mode(obj)
    for name, indices in mesh_elements.elements(obj.data, chosen, domain).items():
        elements = getattr(obj.data, name)
        flags = np.zeros(len(elements), bool)
        flags[indices] = True
        elements.foreach_set("select", flags)
        hidden = np.empty_like(flags)
        elements.foreach_get("hide", hidden)
        if (hidden & flags).any():  # hidden elements are not visible and do not stay selected
            elements.foreach_set("hide", hidden & ~flags)
    obj.data.update_tag()
    context.tool_settings.mesh_select_mode = (False, domain == "EDGE", domain == "FACE")
    # In Edit Mode, the first Undo only leaves the mode. The changes above need their own undo step.
    bpy.ops.ed.undo_push(message="Select Faces")
    bpy.ops.object.mode_set(mode="EDIT")


def _leave_mode(active: bpy.types.Object | None) -> None:
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
