# SPDX-License-Identifier: GPL-3.0-or-later
"""Datablocks that came into the open file, and their removal."""

from collections.abc import Iterator, Sequence

import bpy

_OTHERS = {"shape_keys", "window_managers", "workspaces", "screens", "all_ids"}
"""Collections of bpy.data whose datablocks come and go with others, or with the window."""


def known() -> set[int]:
    """The session_uid of all datablocks of the open file that a bake and importers can add."""
    return {each.session_uid for each in _all()}


def remove_new(before: set[int], kinds: Sequence[str] = ()) -> None:
    """Remove all datablocks but those that `known` returned before. kinds: only of these collections of bpy.data."""
    bpy.data.batch_remove([each for each in _all(kinds) if each.session_uid not in before])


def _all(kinds: Sequence[str] = ()) -> Iterator[bpy.types.ID]:
    kinds = kinds or [each.identifier for each in bpy.data.bl_rna.properties if each.type == "COLLECTION"]
    return (each for kind in kinds if kind not in _OTHERS for each in getattr(bpy.data, kind))
