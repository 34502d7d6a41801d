# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates objects for reading: shows them, switches them to Object Mode, and restores their state afterwards."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TypeVar

import bpy

from ..core.declarations.choices import Modifiers
from ..core.errors import BakeError
from . import dependencies, mesh_reader, object_checks, render_view

Result = TypeVar("Result")


def set_until(owner: bpy.types.bpy_struct, name: str, value: object, restore: ExitStack) -> None:
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


def shown_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The objects that may have a surface, and that both the view layer and renders show.

    What is a holdout, or for indirect light alone, is hidden from the camera: it still shades the rest.
    """
    context.view_layer.update()  # a script may have made some without a redraw
    objects = filter(object_checks.may_show, context.view_layer.objects)
    rendered = {obj.session_uid for obj in _rendered(context.view_layer.layer_collection)}
    return [
        obj
        for obj in objects
        if obj.session_uid in rendered and is_visible(obj) and not object_checks.matrix_problem(obj)
    ]


def _rendered(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Object]:
    """The objects that renders show of a collection and of those in it; one may come several times."""
    if layer.collection.hide_render:
        return
    if not layer.exclude:  # those in it may be shown all the same
        yield from (obj for obj in layer.collection.objects if not obj.hide_render)
    for child in layer.children:
        yield from _rendered(child)


def reveal(context: bpy.types.Context, obj: bpy.types.Object, restore: ExitStack) -> None:
    """Make `obj` visible until `restore` is closed. Raises BakeError if that is not possible."""
    if is_visible(obj):
        return
    set_until(obj, "hide_viewport", False, restore)
    objects = context.view_layer.objects
    if obj in objects.values():
        _unhide(obj, restore)
    context.view_layer.update()
    if is_visible(obj):
        return
    # Its collections are hidden or excluded, but the scene's own collection never is. Link the object there for now.
    scene_objects = context.scene.collection.objects
    if obj not in scene_objects.values() and context.scene.is_editable:
        scene_objects.link(obj)
        restore.callback(scene_objects.unlink, obj)
        _unhide(obj, restore)
        context.view_layer.update()
    if not is_visible(obj):
        raise BakeError(
            f"{obj.name!r} is in a hidden collection: show the collection, so that the object is evaluated."
        )


def show_object(context: bpy.types.Context, obj: bpy.types.Object) -> None:
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


def check_can_show(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Raise BakeError if `obj` cannot be shown or hidden by itself, because of its collection. It stays as it is."""
    with ExitStack() as restore:
        is_here = obj in context.view_layer.objects.values()
        if is_here:
            set_until(obj, "hide_viewport", False, restore)
            _unhide(obj, restore)
            context.view_layer.update()
        if not is_here or not is_visible(obj):
            raise BakeError(f"{obj.name!r} is in a hidden or excluded collection: show the collection.")


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


def shown_collections(layer: bpy.types.ViewLayer) -> list[bpy.types.Collection]:
    """The collections whose objects a view layer has: those that are not excluded."""
    found, left = [], [layer.layer_collection]
    while left:
        each = left.pop()
        left += each.children
        found += [] if each.exclude else [each.collection]
    return found


def _unhide(obj: bpy.types.Object, restore: ExitStack) -> None:
    if obj.hide_get():
        obj.hide_set(False)
        restore.callback(obj.hide_set, True)


def leave_modes(layer: bpy.types.ViewLayer, meshes: set[bpy.types.Mesh], restore: ExitStack) -> None:
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
        set_until(obj, "hide_viewport", False, restore)
        restore.callback(_switch_mode, layer, obj, obj.mode)
    for obj in leaving:
        was_sculpted = obj.mode == "SCULPT"
        _switch_mode(layer, obj, "OBJECT")
        if was_sculpted:
            mesh_reader.reset_normals(obj.data)


@contextmanager
def in_object_mode(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Switch `objects`, and those that they are made from, to Object Mode until the block ends.

    Raises BakeError for a mesh that is in Edit Mode in another view layer.
    """
    context.view_layer.update()  # a script may have removed objects, which leaves gaps in the view layer
    read = _read_by(objects)
    with ExitStack() as restore:
        leave_modes(context.view_layer, {obj.data for obj in read if obj.data}, restore)
        for obj in read:
            if obj.data and getattr(obj.data, "is_editmode", False):
                raise BakeError(f"The mesh of {obj.name!r} is in Edit Mode outside this view layer: leave it there.")
        yield


def _switch_mode(layer: bpy.types.ViewLayer, obj: bpy.types.Object, mode: str) -> None:
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


SUBDIVIDING = {"SUBSURF", "MULTIRES"}
"""Modifier types that have levels and can smooth UVs."""


def evaluate(
    context: bpy.types.Context,
    objects: Sequence[bpy.types.Object],
    work: Callable[[bpy.types.Depsgraph], Result],
    *,
    modifiers: str,
    own_base: bpy.types.Object | None = None,
) -> Result:
    """What `work` returns of the evaluated `objects`, in Object Mode. Raises what it raises.

    Args:
        work: gets the dependency graph: that of a render, or that of the viewport, in which all objects are visible meanwhile.
            Nothing of it may be kept.
        modifiers: as in Settings.
        own_base: an object that is baked onto its own mesh, whose modifiers leave UVs where they are.

    Raises BakeError for an object that cannot be evaluated or has no valid transform, and while a render runs.
    """

    def checked(depsgraph: bpy.types.Depsgraph) -> Result:
        shown = [obj.evaluated_get(depsgraph) for obj in objects]
        hidden = next((obj for obj in shown if not obj.is_evaluated), None)
        if hidden is not None:
            raise BakeError(f"Blender does not evaluate {hidden.name!r}: show it, and its collection.")
        reason = next(filter(None, map(object_checks.matrix_problem, shown)), "")
        if reason:
            raise BakeError(reason)
        return work(depsgraph)

    with ExitStack() as restore:
        if modifiers == Modifiers.VIEWPORT:
            depsgraph = context.evaluated_depsgraph_get()
            for obj in objects:
                # What the eye alone hides is evaluated, but for its instances.
                if object_checks.shows_more(obj) or not obj.evaluated_get(depsgraph).is_evaluated:
                    reveal(context, obj, restore)
        restore.enter_context(in_object_mode(context, objects))
        if own_base is not None:
            _fix_uvs(own_base, restore)
        if modifiers == Modifiers.VIEWPORT:
            return checked(context.evaluated_depsgraph_get())
        return render_view.read(context, objects, checked)


@contextmanager
def with_visible_instances(
    context: bpy.types.Context, highs: Sequence[bpy.types.Object]
) -> Iterator[bpy.types.Depsgraph]:
    """Make the instances of `highs` visible until the block ends. Yields the evaluated dependency graph.

    Blender evaluates objects that the eye icon hides, but not their instances.
    """
    with ExitStack() as restore:
        for high in highs:
            if object_checks.shows_more(high) and high.hide_get():
                high.hide_set(False)
                restore.callback(high.hide_set, True)
        yield context.evaluated_depsgraph_get()


def smooths_uvs(obj: bpy.types.Object) -> bool:
    """Whether a modifier of `obj` moves its UVs. Bakes onto its own base mesh prevent that."""
    return any(modifier.type in SUBDIVIDING and modifier.uv_smooth != "NONE" for modifier in obj.modifiers)


@contextmanager
def with_fixed_uvs(context: bpy.types.Context, obj: bpy.types.Object) -> Iterator[bpy.types.Depsgraph]:
    """Keep modifiers of `obj` from moving its UVs until the block ends. Yields the evaluated dependency graph."""
    with ExitStack() as restore:
        _fix_uvs(obj, restore)
        yield context.evaluated_depsgraph_get()


def _read_by(objects: Sequence[bpy.types.Object]) -> Sequence[bpy.types.Object]:
    """`objects` and those that they are made from or show, if any object is in another mode than Object Mode."""
    if all(obj.mode == "OBJECT" for obj in bpy.data.objects):
        return objects
    used = [block for block in dependencies.used_by(objects) if isinstance(block, bpy.types.Object)]
    return list(dict.fromkeys([*used, *(inner for obj in used for inner in object_checks.instance_sources(obj))]))


def _fix_uvs(obj: bpy.types.Object, restore: ExitStack) -> None:
    # Subdivision can move UVs. Then the detail would not be in its place in the UV layout of the base mesh.
    for modifier in obj.modifiers:
        if modifier.type in SUBDIVIDING:
            set_until(modifier, "uv_smooth", "NONE", restore)
