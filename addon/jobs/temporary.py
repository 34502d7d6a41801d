# SPDX-License-Identifier: GPL-3.0-or-later
"""Datablocks that exist only while a mesh is made, or stay only if all of a task succeeds."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager

import bpy

TEMPORARY = "Imprint temporary"
"""The name, or its start, of datablocks that exist within one step of a task, or as meshes until its end."""


@contextmanager
def meshes() -> Iterator[None]:
    """Remove all meshes that the block has made, at its end, but those that have got another name than TEMPORARY."""
    before = datablocks()
    try:
        yield
    finally:
        for each in [each for each in bpy.data.meshes if each.name.startswith(TEMPORARY)]:
            if each.session_uid not in before:
                bpy.data.meshes.remove(each)


@contextmanager
def only_if_finished() -> Iterator[None]:
    """Remove all datablocks that the block has made, if it fails."""
    before, is_finished = datablocks(), False
    try:
        yield
        is_finished = True
    finally:
        if not is_finished:
            remove_all_but(before)


def datablocks() -> set[int]:
    """The session_uids of all datablocks that a job and importers can add to the open file."""
    return {each.session_uid for each in _all()}


def remove_all_but(known: Collection[int]) -> None:
    """Remove the datablocks that have come since these `datablocks`."""
    bpy.data.batch_remove([each for each in _all() if each.session_uid not in known])


def _all() -> Iterator[bpy.types.ID]:
    kinds = (each.identifier for each in bpy.data.bl_rna.properties if each.type == "COLLECTION")
    return (each for kind in kinds if kind not in _OTHERS for each in getattr(bpy.data, kind))


_OTHERS = {"shape_keys", "window_managers", "workspaces", "screens", "all_ids"}
"""Collections of bpy.data whose datablocks come and go with others, or with the window."""


@contextmanager
def scene() -> Iterator[bpy.types.Scene]:
    """An empty scene. At the end it is removed, with its objects and their meshes."""
    made = bpy.data.scenes.new(TEMPORARY)
    try:
        yield made
    finally:
        for obj in list(made.collection.objects):
            bpy.data.meshes.remove(obj.data)  # and the object with it
        bpy.data.scenes.remove(made)


def add_object(into: bpy.types.Scene, data: bpy.types.Mesh) -> bpy.types.Object:
    obj = bpy.data.objects.new(TEMPORARY, data)
    into.collection.objects.link(obj)
    return obj


def evaluated(within: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Mesh:
    """The mesh of `obj` with its modifiers and without its vertex groups."""
    layer = within.view_layers[0]
    layer.update()
    result = bpy.data.meshes.new_from_object(obj.evaluated_get(layer.depsgraph), depsgraph=layer.depsgraph)
    result.name = TEMPORARY
    return result
