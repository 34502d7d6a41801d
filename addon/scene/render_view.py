# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates objects as renders do, which see other objects, levels and settings than the viewport.

Blender makes the dependency graph of a render only for exporters, which write files, and for render engines. So an engine of
Imprint bakes a triangle in a copy of the scene, and what has to be read is read meanwhile. Blender's bake needs no camera,
changes no render result and none of its slots, and opens no window, unlike a render. The copy has all settings of the scene:
frame, Simplify, units, gravity, and so on. It links only the objects to read, as Blender evaluates what they depend on, too:
with all objects of the scene, each bake of many pairs would evaluate all of them.
"""

import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, ClassVar, NamedTuple, TypeVar

import bpy

from ..core.errors import BakeError
from . import dependencies

Result = TypeVar("Result")
NAME = "Imprint reader"
"""Of all that is made here."""
JOBS = ("RENDER", "OBJECT_BAKE")
"""Blender's jobs during which no other engine may be called."""


class _Call:
    """What to do in the engine, and what came of it: Blender would print an error, and go on."""

    def __init__(self, work: Callable[[bpy.types.Depsgraph], Any], *, is_second: bool):
        self.work, self.result, self.is_second = work, None, is_second
        self.error: BaseException | None = None
        self.was_made = False

    def __enter__(self) -> None:
        self.was_made = True

    def __exit__(self, _kind, error: BaseException | None, _trace) -> bool:
        self.error = error
        if error is not None:
            traceback.clear_frames(error.__traceback__)  # they hold the dependency graph, which is freed soon
        return True


class _Again(Exception):
    """Something has to be done outside of the engine before the objects are read."""

    def __init__(self, first: Callable[[], None]):
        super().__init__()
        self.first = first


class _Engine(bpy.types.RenderEngine):
    """Draws nothing. In a window it is registered while it is used, in the background until Blender ends."""

    bl_idname, bl_label = "IMPRINT_READER", NAME
    call: ClassVar[_Call]

    def bake(self, depsgraph, _object, _pass_type, _pass_filter, _width, _height):
        call = _Engine.call
        with call:
            call.result = call.work(depsgraph)


def read(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], work: Callable[[bpy.types.Depsgraph], Result]
) -> Result:
    """What `work` returns of the dependency graph of a render, which is gone afterwards. Raises what it raises.

    objects: those that it reads. They are evaluated also if they are hidden, and in excluded collections. Of what they show as
    instances, what renders hide is left out.

    Raises BakeError while a render runs.
    """
    try:
        return _read(context, objects, _Call(work, is_second=False))
    except _Again as again:
        again.first()
    return _read(context, objects, _Call(work, is_second=True))


def outside(work: Callable[[], None]) -> None:
    """Call what registers classes. Blender frees engines then, so that inside of one the reading begins again after it."""
    call = getattr(_Engine, "call", None)
    if call is None:
        work()
    elif not call.is_second:
        raise _Again(work)


def _read(context: bpy.types.Context, objects: Sequence[bpy.types.Object], call: _Call) -> Any:
    check_free()
    context.view_layer.update()  # tells handlers what has changed until now
    with _without_handlers(), _scene(context, objects) as (scene, triangle), _engine(scene, call):
        why = _bake(scene, scene.view_layers[context.view_layer.name], triangle)
    if call.error is not None:
        raise call.error
    if not call.was_made:
        raise BakeError(_refused(why or "Blender did not call the engine for it"))
    return call.result


def unregister() -> None:
    """Unregister the engine. Never call this while an engine renders, as older_blender.with_gpu has one: Blender frees it."""
    if _Engine.is_registered:
        bpy.utils.unregister_class(_Engine)


def check_free() -> None:
    """Raise BakeError while Blender renders or bakes: then nothing may be made or changed, not even for a moment."""
    if is_busy():
        raise BakeError(_refused("a render or a bake of Blender runs"))


def is_busy() -> bool:
    """Whether Blender renders or bakes."""
    return any(map(bpy.app.is_job_running, JOBS))


def _refused(why: str) -> str:
    return f"The objects cannot be read as renders see them, since {why}: wait, or set Modifiers to Viewport."


def _bake(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, triangle: bpy.types.Object) -> str:
    """Let Blender call the engine. Returns why it did not, as a clause; empty if it says nothing."""
    chosen = {name: [triangle] for name in ("selected_objects", "selected_editable_objects")}
    with bpy.context.temp_override(scene=scene, view_layer=layer, object=triangle, active_object=triangle, **chosen):
        try:
            _call_engine(type="EMIT", target="VERTEX_COLORS", use_clear=False, use_selected_to_active=False)
        except RuntimeError as error:
            return f"Blender says: {str(error).removeprefix('Error: ').strip().rstrip('.')}"
    return ""


def _call_engine(**options) -> None:
    bpy.ops.object.bake(**options)


@contextmanager
def _without_handlers() -> Iterator[None]:
    """Keep Blender from calling handlers in the block: the copy of the scene is no concern of other add-ons."""
    lists = [value for name in dir(bpy.app.handlers) if isinstance(value := getattr(bpy.app.handlers, name), list)]
    kept = [list(each) for each in lists]
    try:
        for each in lists:
            each.clear()
        yield
    finally:
        for each, before in zip(lists, kept, strict=True):
            each[:] = before


@contextmanager
def _engine(scene: bpy.types.Scene, call: _Call) -> Iterator[None]:
    """Let the engine, with this call, be that of the scene until the block ends."""
    with ExitStack() as restore:
        if not _Engine.is_registered:
            bpy.utils.register_class(_Engine)
        if not bpy.app.background:  # or a window would offer it
            restore.callback(unregister)
        _Engine.call = call
        restore.callback(delattr, _Engine, "call")
        restore.callback(setattr, scene.render, "engine", scene.render.engine)
        scene.render.engine = _Engine.bl_idname
        yield


@contextmanager
def _scene(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object]
) -> Iterator[tuple[bpy.types.Scene, bpy.types.Object]]:
    """A scene that shows `objects` to renders, and an object to bake, until the block ends."""
    made: list[bpy.types.ID] = []
    needs = _Needs.of(context, objects)
    with ExitStack() as restore:
        restore.callback(bpy.data.batch_remove, made)
        scene = context.scene
        if not needs.own_scene:
            scene = context.scene.copy()
            made.append(scene)
            _empty(scene.collection)
        shown = bpy.data.collections.new(NAME)
        made.append(shown)
        shown.hide_viewport = not needs.viewport  # or Blender would evaluate all twice, for the viewport as well
        scene.collection.children.link(shown)
        for obj in needs.linked:
            shown.objects.link(obj)
        for obj in objects:
            for name in ("hide_render", "hide_viewport")[: 1 + needs.viewport]:
                if getattr(obj, name):
                    setattr(obj, name, False)
                    restore.callback(setattr, obj, name, True)
        triangle = _triangle(made)
        scene.collection.objects.link(triangle)
        yield scene, triangle


def _empty(root: bpy.types.Collection) -> None:
    for child in list(root.children):
        root.children.unlink(child)
    for obj in list(root.objects):
        root.objects.unlink(obj)


def _triangle(made: list[bpy.types.ID]) -> bpy.types.Object:
    """An object with what Blender's bake asks for."""
    data = bpy.data.meshes.new(NAME)
    made.append(data)
    data.from_pydata([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], [], [(0, 1, 2)])
    data.uv_layers.new()
    data.color_attributes.new(NAME, "FLOAT_COLOR", "POINT")
    obj = bpy.data.objects.new(NAME, data)
    made.append(obj)
    return obj


# What else the copy must have

PHYSICS = {"CLOTH", "SOFT_BODY", "DYNAMIC_PAINT", "FLUID", "PARTICLE_SYSTEM"}
"""Types of modifiers that fields, colliders and fluids in the whole scene act on."""


class _Needs(NamedTuple):
    """What a scene must have, so that objects are evaluated in it as in the user's.

    Attributes:
        linked: The objects to link.
        viewport: Whether the viewport has to evaluate them, too: it alone tells errors of nodes, and it evaluates no objects
            that are hidden in it.
        own_scene: Whether only the user's scene itself has what is needed: the state of rigid bodies is not copied.
    """

    linked: list[bpy.types.Object]
    viewport: bool = False
    own_scene: bool = False

    @classmethod
    def of(cls, context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> "_Needs":
        if not any(_looks_around(obj) or _has_nodes(obj) for obj in bpy.data.objects):
            return cls(list(objects))
        used = [block for block in dependencies.used_by(objects) if isinstance(block, bpy.types.Object)]
        linked = dict.fromkeys(objects)
        if any(map(_looks_around, used)):  # all that renders show
            linked |= dict.fromkeys(
                obj for obj in _rendered(context.view_layer.layer_collection) if not obj.hide_render
            )
        return cls(
            list(linked),
            any(_has_nodes(obj) and not obj.visible_get(view_layer=context.view_layer) for obj in used),
            any(obj.rigid_body is not None for obj in used),
        )


def _looks_around(obj: bpy.types.Object) -> bool:
    """Whether the shape of `obj` depends on objects in the scene that neither it nor its modifiers name."""
    return (
        obj.type in {"META", "GREASEPENCIL"}  # other balls of the family; lines of all objects
        or obj.instance_type in {"VERTS", "FACES"}  # children
        or obj.rigid_body is not None
        or len(obj.particle_systems) > 0
        or any(modifier.type in PHYSICS for modifier in obj.modifiers)
    )


def _has_nodes(obj: bpy.types.Object) -> bool:
    return any(modifier.type == "NODES" for modifier in obj.modifiers)


def _rendered(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Object]:
    """The objects in the collections that renders of a view layer show."""
    if layer.collection.hide_render:
        return
    if not layer.exclude:
        yield from layer.collection.objects
    for child in layer.children:
        yield from _rendered(child)
