# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds scenes in few words: objects, pairs, UVs, weights, materials, images, files, and small bakes of them.

`tests/support/zoo.py` has the meshes, and `tests/support/layouts.py` squares whose UVs have a closed form.
"""

from pathlib import Path

import bpy
import numpy as np

from addon.core.settings import Settings
from addon.jobs import bake_pair
from tests.support import zoo

SMALL = {"width": 64, "height": 64, "margin": 0, "depth": 32, "storage": "MEMORY", "material": False}
"""The settings of a small float map in memory, without margin and material."""


# Objects


def link(obj) -> bpy.types.Object:
    """Link an object to the scene's collection. Returns it."""
    bpy.context.scene.collection.objects.link(obj)
    return obj


def select(active, *others) -> bpy.types.Object:
    """Select these objects and no others. Returns the active one."""
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in (active, *others))
    bpy.context.view_layer.objects.active = active
    return active


def planes(*names, height=0.0, slope=0.0, n=1) -> list[bpy.types.Object]:
    """Flat squares of these names, the first in z = 0 and the others at `height`, with a slope, in n x n quads."""
    first, *others = names
    made = [zoo.plane(first), *(zoo.plane(name, n, slope=slope) for name in others)]
    for obj in made[1:]:
        obj.location.z = height
    return made


def terrains(low="lo", high="hi", *, coarse=8, fine=24, height=0.15) -> tuple[bpy.types.Object, bpy.types.Object]:
    """A low terrain and a high one over it whose waves are as high as `height`."""
    return zoo.terrain(low, coarse), zoo.terrain(high, fine, height=height)


def move_uvs(obj, scale=(1.0, 1.0), offset=(0.0, 0.0), loops=slice(None)) -> None:
    """Scale the UVs of the first layer from (0, 0) and then move them, at some of the loops."""
    layer = obj.data.uv_layers[0].uv
    uv = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", uv.ravel())
    uv[loops] = uv[loops] * scale + offset
    layer.foreach_set("vector", uv.ravel())


def weigh(obj, name, weights) -> bpy.types.VertexGroup:
    """Add a vertex group. weights: (V,) from 0 to 1, or one number for all vertices."""
    group = obj.vertex_groups.new(name=name)
    for vertex, weight in enumerate(np.broadcast_to(weights, len(obj.data.vertices)).tolist()):
        group.add([vertex], weight, "REPLACE")
    return group


# Images and materials


def image(name, values, *, space="sRGB", is_float=False, alpha=None) -> bpy.types.Image:
    """A packed image of stored values (H, W, 3 or less) from 0 to 1. alpha: (H, W), or None for 1."""
    values = np.asarray(values, np.float32)
    height, width = values.shape[:2]
    made = bpy.data.images.new(name, width, height, alpha=True, float_buffer=is_float, is_data=space == "Non-Color")
    made.colorspace_settings.name = space
    made.alpha_mode = "CHANNEL_PACKED"
    texels = np.ones((height, width, 4), np.float32)
    texels[..., :3] = values if values.ndim == 3 else values[..., None]
    if alpha is not None:
        texels[..., 3] = alpha
    made.pixels.foreach_set(texels.ravel())
    made.pack()
    return made


def image_file(path, color=(0.5, 0.5, 0.5), size=8) -> Path:
    """Save a square image of one stored color as .png or .jpg. Returns its path."""
    path = Path(path)
    made = bpy.data.images.new(path.stem, size, size)
    made.pixels.foreach_set(np.tile(np.array([*color, 1.0], np.float32), size * size))
    made.filepath_raw, made.file_format = str(path), {".png": "PNG", ".jpg": "JPEG"}[path.suffix]
    made.save()
    bpy.data.images.remove(made)
    return path


def material(name, *objects, **sockets) -> bpy.types.Material:
    """A material in a new slot of these objects. sockets: as in `set_inputs`."""
    made = bpy.data.materials.new(name)
    if made.node_tree is None:  # Blender 4.5
        made.use_nodes = True
    set_inputs(made, **sockets)
    for obj in objects:
        obj.data.materials.append(made)
    return made


def set_inputs(changed, **sockets) -> None:
    """Give the Principled BSDF of a material values, or output sockets, by the name of the input with _ for spaces."""
    shader = changed.node_tree.nodes["Principled BSDF"]
    for socket, value in sockets.items():
        target = shader.inputs[socket.replace("_", " ")]
        if isinstance(value, bpy.types.NodeSocket):
            changed.node_tree.links.new(value, target)
        else:
            target.default_value = (*value, 1.0) if target.type == "RGBA" and len(value) == 3 else value


def texture(changed, shown, **properties) -> bpy.types.Node:
    """Add an Image Texture node that shows an image to a material."""
    node = changed.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = shown
    for name, value in properties.items():
        setattr(node, name, value)
    return node


def show(obj, shown, socket="Base Color", **properties) -> bpy.types.Node:
    """Give an object a new material that shows an image in an input. Returns the Image Texture node."""
    made = material(shown.name, obj)
    node = texture(made, shown, **properties)
    set_inputs(made, **{socket: node.outputs["Color"]})
    return node


# Files


def save(path) -> str:
    """Save the open file there. Returns the path."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return str(path)


def plane_files(folder, **slopes):
    """Write an .obj for each name, of a plane with this slope. The scene is empty then."""
    for name, slope in slopes.items():
        zoo.plane(name, slope=slope)
        bpy.ops.wm.obj_export(filepath=str(folder / f"{name}.obj"), export_materials=False)
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def from_library(path, kind, *names) -> list:
    """Link datablocks of a kind ("objects", "materials") from a .blend, all by default. Objects get into the scene, too."""
    with bpy.data.libraries.load(str(path), link=True) as (there, here):
        setattr(here, kind, list(names) or getattr(there, kind))
    found = list(getattr(here, kind))
    return [link(obj) for obj in found] if kind == "objects" else found


def to_library(path, block):
    """Move an object or a material into a new .blend. Returns it as linked from there, an object not yet in the scene."""
    kind, name = "objects" if isinstance(block, bpy.types.Object) else "materials", block.name
    bpy.data.libraries.write(str(path), {block})
    getattr(bpy.data, kind).remove(block)
    with bpy.data.libraries.load(str(path), link=True) as (_, here):
        setattr(here, kind, [name])
    return getattr(here, kind)[0]


# Bakes


def settings(method="FLATTEN", **values) -> Settings:
    """Settings of a small float map. size: the width and the height, instead of both."""
    if "size" in values:
        size = values.pop("size")
        values["width"], values["height"] = size if isinstance(size, tuple) else (size, size)
    return Settings(method=method, **{**SMALL, **values})


def bake(low, *highs, cage=None, **values):
    """The report of a small bake. values: as in `settings`."""
    return bake_pair(bpy.context, low, highs, settings(**values), cage)


def in_slots(low, *highs, **values) -> bpy.types.PropertyGroup:
    """Put objects into the slots of the panel, and set values of its settings, 64 x 64 by default. Returns the settings."""
    panel = bpy.context.scene.imprint
    panel.low = low
    for high in highs:
        panel.highs.add().object = high
    for name, value in {"width": 64, "height": 64, **values}.items():
        setattr(panel, name, value)
    return panel
