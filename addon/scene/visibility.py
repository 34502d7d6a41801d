# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows hidden objects while they are read: Blender evaluates only visible objects."""

from contextlib import ExitStack

import bpy

from ..core.errors import BakeError


def put(owner: bpy.types.bpy_struct, name: str, value: object, restore: ExitStack) -> None:
    """Set a property if it differs, and restore it when `restore` is closed.

    Setting an equal value would make Blender evaluate the object again."""
    before = getattr(owner, name)
    if before != value:
        setattr(owner, name, value)
        restore.callback(setattr, owner, name, before)


def is_visible(obj: bpy.types.Object) -> bool:
    """Whether `obj` is visible in the view layer. The local view of the current viewport does not matter."""
    with bpy.context.temp_override(area=None, region=None):
        return obj.visible_get()


def reveal(context: bpy.types.Context, obj: bpy.types.Object, restore: ExitStack) -> None:
    """Make `obj` visible until `restore` is closed. Raises BakeError if that is not possible."""
    if is_visible(obj):
        return
    put(obj, "hide_viewport", False, restore)
    objects = context.view_layer.objects
    if obj in objects.values():
        _show(obj, restore)
    context.view_layer.update()
    if is_visible(obj):
        return
    # Its collections are hidden or excluded, but the scene's own collection never is. Link the object there for now.
    scene_objects = context.scene.collection.objects
    if obj not in scene_objects.values() and context.scene.is_editable:
        scene_objects.link(obj)
        restore.callback(scene_objects.unlink, obj)
        _show(obj, restore)
        context.view_layer.update()
    if not is_visible(obj):
        raise BakeError(
            f"{obj.name!r} is in a hidden collection: show the collection, so that the object is evaluated."
        )


def show(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make `obj` visible for good. Raises BakeError if its collection hides it."""
    if obj not in context.scene.collection.all_objects.values():  # it came along with an object of another file
        context.scene.collection.objects.link(obj)
    if obj.hide_viewport:
        obj.hide_viewport = False
    if obj in context.view_layer.objects.values():
        obj.hide_set(False)
    context.view_layer.update()
    if not is_visible(obj):
        raise BakeError(f"{obj.name!r} is in a hidden collection: show the collection.")


def is_followed(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    """Whether Blender evaluates `obj` when it changes: if it is visible, or hidden only by the eye icon in the Outliner."""
    if is_visible(obj):
        return True
    objects = context.view_layer.objects
    return not obj.hide_viewport and obj in objects.values() and _contains(context.view_layer.layer_collection, obj)


def _contains(layer: bpy.types.LayerCollection, obj: bpy.types.Object) -> bool:
    if layer.collection.hide_viewport:
        return False
    is_here = not layer.exclude and obj in layer.collection.objects.values()
    return is_here or any(_contains(child, obj) for child in layer.children)


def _show(obj: bpy.types.Object, restore: ExitStack) -> None:
    if obj.hide_get():
        obj.hide_set(False)
        restore.callback(obj.hide_set, True)
