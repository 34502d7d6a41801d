# SPDX-License-Identifier: GPL-3.0-or-later
"""Switches objects to Object Mode while they are read, and finds out what Sculpt Mode hides."""

from contextlib import ExitStack

import bpy

from . import mesh_reader, visibility


def leave(layer: bpy.types.ViewLayer, meshes: set[bpy.types.Mesh], restore: ExitStack) -> None:
    """Switch all objects that use one of `meshes` to Object Mode until `restore` is closed."""
    # In Edit Mode and Sculpt Mode, edits reach the mesh when the mode is left. Any object that uses the mesh can be in that
    # mode.
    leaving = [obj for obj in layer.objects if obj.mode != "OBJECT" and obj.data in meshes]
    if any(obj.mode == "EDIT" for obj in leaving):  # all objects leave Edit Mode together, and all selected ones enter
        leaving += [obj for obj in layer.objects if obj.mode == "EDIT" and obj not in leaving]
    if not leaving:
        return
    # Objects in Edit Mode come first, so that they enter it last: Blender crashes if an object enters a paint mode whose
    # mesh is in Edit Mode on another object.
    leaving.sort(key=lambda obj: obj.mode != "EDIT")
    restore.callback(setattr, layer.objects, "active", layer.objects.active)
    for obj in layer.objects.selected.values():
        restore.callback(obj.select_set, True)
        obj.select_set(False)
    for obj in leaving:
        # Blender does not switch the mode of hidden objects.
        visibility.put(obj, "hide_viewport", False, restore)
        restore.callback(_switch, layer, obj, obj.mode)
    for obj in leaving:
        was_sculpted = obj.mode == "SCULPT"
        _switch(layer, obj, "OBJECT")
        if was_sculpted:
            mesh_reader.reset_normals(obj.data)


def _switch(layer: bpy.types.ViewLayer, obj: bpy.types.Object, mode: str) -> None:
    if obj.mode != mode:
        layer.objects.active = obj
        bpy.ops.object.mode_set(mode=mode)


def hides_detail(obj: bpy.types.Object) -> bool:
    """Whether Sculpt Mode hides the Multires detail of `obj` from evaluation."""
    return obj.mode == "SCULPT" and any(modifier.type == "MULTIRES" for modifier in obj.modifiers)


def holds_strokes(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    """Whether Blender reports strokes on `obj` only when the mesh is requested.

    It does with Dyntopo, or if Sculpt Mode shows only deforming modifiers."""
    if obj.mode != "SCULPT":
        return False
    only_deforms = obj.modifiers and context.scene.tool_settings.sculpt.use_deform_only
    return bool(obj.use_dynamic_topology_sculpting or only_deforms)
