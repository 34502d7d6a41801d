# SPDX-License-Identifier: GPL-3.0-or-later
"""Modes that objects leave for as long as they are read."""

from contextlib import ExitStack

import bpy

from . import mesh_reader, visibility


def leave(layer: bpy.types.ViewLayer, meshes: set[bpy.types.Mesh], restore: ExitStack) -> None:
    """Put whoever shares one of `meshes` into Object Mode until `restore` is closed."""
    # The mesh of an object in Edit Mode or Sculpt Mode lags behind what is on screen until the mode is left; by whom,
    # does not matter to the objects that share it.
    leaving = [obj for obj in layer.objects if obj.mode != "OBJECT" and obj.data in meshes]
    if any(obj.mode == "EDIT" for obj in leaving):  # which all objects leave together, and the selected ones enter
        leaving += [obj for obj in layer.objects if obj.mode == "EDIT" and obj not in leaving]
    if not leaving:
        return
    # First, and so entered last: Blender crashes where a mesh in Edit Mode is to be painted on another object.
    leaving.sort(key=lambda obj: obj.mode != "EDIT")
    restore.callback(setattr, layer.objects, "active", layer.objects.active)
    for obj in layer.objects.selected.values():
        restore.callback(obj.select_set, True)
        obj.select_set(False)
    for obj in leaving:
        # Hidden objects are not let out of their modes, nor into them.
        visibility.put(obj, "hide_viewport", False, restore)
        restore.callback(_switch, layer, obj, obj.mode)
    for obj in leaving:
        was_sculpted = obj.mode == "SCULPT"
        _switch(layer, obj, "OBJECT")
        if was_sculpted:
            mesh_reader.derive_anew(obj.data)


def _switch(layer: bpy.types.ViewLayer, obj: bpy.types.Object, mode: str) -> None:
    if obj.mode != mode:
        layer.objects.active = obj
        bpy.ops.object.mode_set(mode=mode)
