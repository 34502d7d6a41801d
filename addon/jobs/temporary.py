# SPDX-License-Identifier: GPL-3.0-or-later
"""Datablocks that exist only while a mesh is made, or stay only if all of a task succeeds."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy

from ..scene import new_datablocks

TEMPORARY = "Imprint temporary"
"""The name, or its start, of datablocks that exist within one step of a task, or as meshes until its end."""

MADE = ("objects", "meshes", "collections", "materials", "images", "node_groups")
"""What assets and levels make in the file."""


@contextmanager
def meshes() -> Iterator[None]:
    """Remove all meshes that the block has made, at its end, but those that have got another name than TEMPORARY."""
    before = new_datablocks.known()
    try:
        yield
    finally:
        for each in [each for each in bpy.data.meshes if each.name.startswith(TEMPORARY)]:
            if each.session_uid not in before:
                bpy.data.meshes.remove(each)


@contextmanager
def only_if_finished() -> Iterator[None]:
    """Remove the datablocks of the kinds of MADE that the block has made, if it fails. Others may come from another window."""
    with ExitStack() as undo:
        undo.callback(new_datablocks.remove_new, new_datablocks.known(), MADE)
        yield
        undo.pop_all()


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
