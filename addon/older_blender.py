# SPDX-License-Identifier: GPL-3.0-or-later
"""All code for Blender 4.5, 5.0 and 5.1, where they differ from 5.2.

To drop them: delete this file, put what the docstring of each function names in place of its calls, and raise
blender_version_min. tests/pure/test_layers.py lists the calls.
"""

import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import bpy
import gpu

from . import passes
from .core.errors import BakeError, NoGpu
from .core.map_types import MARK
from .engine import gpu_memory

if TYPE_CHECKING:
    from .output.tree_editing import TreeEditor

Result = TypeVar("Result")

DIRECTX = "DIRECTX"
"""The convention of normal maps whose green points down, as the Normal Map node of Blender 5.1 names it."""


# Before 5.2: no GPU in the background


def start_gpu() -> None:
    """In 5.2: `gpu.init()`. Raises SystemError or RuntimeError if there is no GPU to draw on."""
    if hasattr(gpu, "init"):
        gpu.init()
    else:
        gpu.capabilities.max_texture_size_get()  # a SystemError in the background, outside of `with_gpu`


def with_gpu(work: Callable[[], Result]) -> Result:
    """In 5.2: `work()`. `work` can draw, but must open no file. Returns its result, and raises what it raises.

    Older versions have a GPU in the background only while a render engine renders that asks for one. So `work` is what such
    an engine does.
    """
    if hasattr(gpu, "init") or not bpy.app.background or _can_draw():
        return work()
    call = _Call()

    class Engine(bpy.types.RenderEngine):
        """Draws nothing that Blender shows."""

        bl_idname, bl_label, bl_use_gpu_context = "IMPRINT_GPU", "Imprint", True

        def render(self, _depsgraph):
            with call:
                call.result = work()

    bpy.utils.register_class(Engine)
    try:
        _render(Engine.bl_idname)
    finally:
        bpy.utils.unregister_class(Engine)
    if call.error is not None:
        raise call.error
    return call.result


class _Call:
    """The result of a call in a render engine, or its error: Blender would print it and go on."""

    def __init__(self):
        self.result: Any = None
        self.error: BaseException | None = NoGpu("There is no GPU to bake on: Blender did not call its render engine.")

    def __enter__(self) -> None:
        self.error = None

    def __exit__(self, _kind, error: BaseException | None, _trace) -> bool:
        self.error = error
        if error is not None:
            traceback.clear_frames(error.__traceback__)  # textures that its frames hold must go now
        gpu_memory.free()  # the next call has another context
        passes.free()
        return True


def _can_draw() -> bool:
    try:
        gpu.capabilities.max_texture_size_get()
    except SystemError:
        return False
    return True


def _render(engine: str) -> None:
    """Render with an engine, in a scene of its own, and leave nothing of it."""
    images = set(bpy.data.images)
    scene = bpy.data.scenes.new("Imprint")
    camera = bpy.data.cameras.new("Imprint")  # Blender renders nothing without one
    scene.camera = bpy.data.objects.new("Imprint", camera)
    scene.render.engine = engine
    scene.render.resolution_x = scene.render.resolution_y = 4
    try:
        bpy.ops.render.render(scene=scene.name)
    finally:
        bpy.data.objects.remove(scene.camera)
        bpy.data.cameras.remove(camera)
        bpy.data.scenes.remove(scene)
        for image in set(bpy.data.images) - images:
            if image.type == "RENDER_RESULT":
                bpy.data.images.remove(image)


# Before 5.1: Normal Map nodes without conventions


def normal_map_values(node: bpy.types.Node, values: dict[str, str]) -> dict[str, str]:
    """In 5.2: `values`. Those that this Blender's node has."""
    return {name: value for name, value in values.items() if hasattr(node, name)}


def normal_map_color(editor: "TreeEditor", normal_map: bpy.types.Node, values: dict[str, str]) -> bpy.types.NodeSocket:
    """In 5.2: `normal_map.inputs["Color"]`. The input that an Image Texture feeds.

    Where the Normal Map node reads no green that points down, a Vector Math node before it turns green around.
    """
    color = normal_map.inputs["Color"]
    if hasattr(normal_map, "convention"):
        return color
    _, node, kind = editor.trace(color)
    turn = node if kind == "ShaderNodeVectorMath.Vector" and node.get(MARK) else None
    is_down = values["convention"] == DIRECTX
    if turn is None and is_down and kind in (None, "ShaderNodeTexImage.Color"):
        turn = editor.own_node("ShaderNodeVectorMath", "Vector", color, "green", "Turn Green")
        turn.operation = "MULTIPLY_ADD"
        if node is not None:
            editor.connect(node.outputs["Color"], turn.inputs[0])
    if turn is None:
        return color
    if not is_down:
        _, texture, kind = editor.trace(turn.inputs[0])
        if kind == "ShaderNodeTexImage.Color":
            editor.connect(texture.outputs["Color"], color)
        return color
    turn.inputs[1].default_value = (1.0, -1.0, 1.0)
    turn.inputs[2].default_value = (0.0, 1.0, 0.0)
    return turn.inputs[0]


def exported_channels(channels: tuple[str, ...]) -> tuple[str, ...]:
    """In 5.2: `channels`. Those of the nodes that an exporter gets: that of .fbx finds no image behind a Vector Math node."""
    has_convention = "convention" in bpy.types.ShaderNodeNormalMap.bl_rna.properties
    return ("+X", "+Y", "+Z") if channels == ("+X", "-Y", "+Z") and not has_convention else channels


# Before 5.0: materials without nodes


def shows_nodes(material: bpy.types.Material) -> bool:
    """In 5.2: `material.node_tree is not None`. Whether renders show the nodes."""
    return material.node_tree is not None and (bpy.app.version >= (5, 0) or material.use_nodes)


def switch_on_nodes(material: bpy.types.Material) -> list[str]:
    """In 5.2: nothing, or `[]`. Makes renders show the nodes of a material. Returns notes for the report.

    Its new nodes have the color, the roughness and the metallic value that it showed.
    """
    if shows_nodes(material):
        return []
    has_old_nodes = material.node_tree is not None
    material.use_nodes = True
    if has_old_nodes:
        return [f'Material "{material.name}": its nodes were switched off; they are on now, as the map is one of them.']
    shader = next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    shader.inputs["Base Color"].default_value = material.diffuse_color
    shader.inputs["Roughness"].default_value = material.roughness
    shader.inputs["Metallic"].default_value = material.metallic
    return [f'Material "{material.name}" had no nodes; it has them now, with its color, roughness and metallic value.']


# Before 5.2: the values of a modifier's nodes are custom properties


def modifier_input(modifier: bpy.types.NodesModifier, identifier: str) -> Any:
    """In 5.2: `getattr(modifier.properties.inputs, identifier).value`. The value of an input of its nodes; None without one."""
    if hasattr(modifier, "properties"):
        return getattr(getattr(modifier.properties.inputs, identifier, None), "value", None)
    return modifier.get(identifier)


# Before 5.0: paths of files in a map, which cannot be changed


def visit_file_paths(visit: Callable[[bpy.types.ID, str, Any], str | None]) -> None:
    """In 5.2: `bpy.data.file_path_foreach(visit)`. Calls `visit` with each datablock and each path of a file that it names.

    What `visit` returns replaces the path, if it is a string. Older versions know how to replace the path of a datablock that
    is a file itself, as an image; others raise BakeError.
    """
    if hasattr(bpy.data, "file_path_foreach"):
        bpy.data.file_path_foreach(visit)
        return
    for owner, paths in bpy.data.file_path_map().items():
        for path in sorted(paths):
            changed = visit(owner, path, None)
            if changed is None:
                continue
            if getattr(owner, "filepath", None) != path:
                raise BakeError(
                    f"Blender {bpy.app.version_string} cannot leave out {path!r} of {owner.name!r}: 5.0 can."
                )
            owner.filepath = changed


# Before 5.0: what add-ons register is stored with the custom properties


def kept_properties(obj: bpy.types.Object) -> Any:
    """In 5.2: `obj.bl_system_properties_get() or {}`. What add-ons keep with an object, also add-ons that are not enabled."""
    if hasattr(obj, "bl_system_properties_get"):
        return obj.bl_system_properties_get() or {}
    return obj
