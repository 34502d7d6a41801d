# SPDX-License-Identifier: GPL-3.0-or-later
"""Adds the modifier that keeps the triangles of a low object as they were baked."""

import bpy
import numpy as np

from ..core.errors import BakeError
from ..core.report import Report
from ..mesh import face_shapes
from ..scene import evaluation, mesh_reader
from .report_making import PastBake


def add_triangulate(context: bpy.types.Context, report: Report) -> tuple[bpy.types.Modifier, int]:
    """Add a Triangulate modifier to the low object of a past bake. As `add`."""
    past = PastBake.of(report)
    return add(context, past.job.low, past.settings.modifiers, is_own_base=past.job.low in past.job.highs)


def add(
    context: bpy.types.Context, low: bpy.types.Object, modifiers: str, *, is_own_base: bool
) -> tuple[bpy.types.Modifier, int]:
    """Add a Triangulate modifier to the low object, with the triangles that Blender draws and that are baked.

    modifiers: as in Settings. is_own_base: whether it is baked without its modifiers.

    Also returns how many quads the modifier cuts along the other diagonal: Blender switches it for quads that would fold.
    Raises BakeError if the object cannot have the modifier, or already has it.
    """
    if not low.is_editable:
        raise BakeError(f"{low.name!r} is linked from another file: make it local to add a modifier.")
    if is_own_base:
        raise BakeError(
            f"{low.name!r} was baked from its own modifiers onto its base mesh: triangulate the base mesh instead."
        )
    if low.modifiers and low.modifiers[-1].type == "TRIANGULATE":
        raise BakeError(f"{low.name!r} already has a Triangulate modifier: {low.modifiers[-1].name!r}.")
    with (
        evaluation.prepared(context, low, [], None, modifiers) as depsgraph,
        mesh_reader.evaluated(low, depsgraph) as data,
    ):
        mesh = mesh_reader.surface(data, "", low.name, mesh_reader.matrix(low), with_faces=True)
    modifier = low.modifiers.new("Triangulate", "TRIANGULATE")
    modifier.quad_method, modifier.ngon_method = "FIXED", "CLIP"
    modifier.keep_custom_normals = True
    return modifier, int(np.count_nonzero(face_shapes.folded(mesh)))


def sentence(low: str, modifier: bpy.types.Modifier, folded: int) -> str:
    """What `add` did to the object `low`."""
    difference = f"; it divides {folded:,} folded quads differently from how Blender draws them" if folded else ""
    return f"{low!r} has the modifier {modifier.name!r}{difference}"
