# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes snapshots of Blender's file and view as plain data: they are equal if a bake left no trace."""

import bpy
import numpy as np

# These depend on what was drawn or read, not on what the artist has set.
FLEETING = {
    "rna_type",
    "bindcode",
    "has_data",
    "frame_duration",
    "users",
    "is_evaluated",
    "tag",
    "is_embedded_data",
    "use_nodes",
    "face_count",
    "bound_box",
    "dimensions",
    "is_library_indirect",  # Blender clears it with the first local user, and finds it anew when the file is saved
    "pixels",  # reading them loads the image: see `pixels` below
}


def snapshot(context=None, *, without=()) -> dict:
    """Everything that a bake must not change, by name. without: collections to which a bake may add.

    Names of all datablocks; settings of scenes, objects, modifiers, view layers and images; selection, active object
    and modes; nodes and links; mesh attributes and image pixels.
    """
    context = context or bpy.context
    context.view_layer.update()  # matrices are updated late
    state = {"active": context.view_layer.objects.active and context.view_layer.objects.active.name_full}
    for collection in _collections():
        if collection not in without:
            state[collection] = sorted(
                block.name_full for block in getattr(bpy.data, collection) if _is_the_files(block)
            )
    for scene in bpy.data.scenes:
        for part in (scene, scene.render, scene.render.image_settings, scene.render.ffmpeg, scene.view_settings):
            state[scene.name, part.bl_rna.identifier] = settings(part)
        for layer in scene.view_layers:
            state[scene.name, layer.name] = _layer(layer)
    for obj in bpy.data.objects:
        state["object", obj.name_full] = settings(obj), obj.mode, [m.name for m in obj.material_slots]
        for modifier in obj.modifiers:
            state["modifier", obj.name_full, modifier.name] = settings(modifier)
    for data in bpy.data.meshes:
        state["mesh", data.name_full] = settings(data), _attributes(data) if not data.is_editmode else None
    if "images" not in without:
        for image in bpy.data.images:
            state["image", image.name_full] = settings(image), settings(image.colorspace_settings), pixels(image)
    if "materials" not in without:
        for material in bpy.data.materials:
            state["material", material.name_full] = _tree(material.node_tree)
    return state


def difference(before: dict, after: dict) -> dict:
    """What changed, as {key: (before, after)}, for readable messages of assertions."""
    return {
        key: _narrowed(before.get(key), after.get(key))
        for key in before.keys() | after.keys()
        if before.get(key) != after.get(key)
    }


def settings(struct) -> dict:
    """The values of the properties of an RNA struct; for pointers, the names of their targets."""
    values = {}
    for prop in struct.bl_rna.properties:
        name = prop.identifier
        if name in FLEETING or prop.type == "COLLECTION":
            continue
        value = getattr(struct, name)
        if prop.type == "POINTER":
            values[name] = value.name_full if isinstance(value, bpy.types.ID) else value is not None
        elif getattr(prop, "is_array", False):
            values[name] = (np.array(value) + 0.0).tolist() if prop.type == "FLOAT" else np.array(value).tolist()
        else:
            values[name] = value + 0.0 if prop.type == "FLOAT" else value
    # NaN differs from itself, and is allowed in coordinates. -0.0 + 0.0 is 0.0, which Blender 5.3 computes anew on the way out
    # of Edit Mode.
    return {name: repr(value) for name, value in values.items()}


def pixels(image) -> bytes:
    """The pixels of an image, if they are loaded."""
    if not image.has_data:
        return b""
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values.tobytes()


def _is_the_files(block) -> bool:
    """Whether a datablock belongs to the file: Blender loads brushes from its own libraries when it enters a mode."""
    path = block.filepath if isinstance(block, bpy.types.Library) else block.library and block.library.filepath
    return not path or "essentials" not in path


def _collections() -> list[str]:
    return [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION" and p.identifier != "all_ids"]


def _layer(layer) -> dict:
    shown = {obj.name_full: (obj.select_get(), obj.hide_get()) for obj in layer.objects}
    waiting, collections = [layer.layer_collection], {}
    while waiting:
        collection = waiting.pop()
        collections[collection.name] = settings(collection)
        waiting += collection.children
    return {"objects": shown, "collections": collections}


def _attributes(data) -> dict:
    """The bytes of the attributes that the user can see; Blender stores internal ones too."""
    wanted = {"position": 3, "material_index": 1} | {layer.name: 2 for layer in data.uv_layers}
    found = {"names": sorted(a.name for a in data.attributes if not a.name.startswith("."))}
    for name, width in wanted.items():
        attribute = data.attributes.get(name)
        if attribute is not None:
            values = np.empty(len(attribute.data) * width, np.int32 if name == "material_index" else np.float32)
            attribute.data.foreach_get("vector" if width > 1 else "value", values)
            found[name] = values.tobytes()
    return found


def _tree(tree) -> tuple:
    nodes = {node.name: settings(node) for node in tree.nodes}
    links = [(x.from_node.name, x.from_socket.identifier, x.to_node.name, x.to_socket.identifier) for x in tree.links]
    return nodes, sorted(links)


def _narrowed(before, after):
    if isinstance(before, dict) and isinstance(after, dict):
        return difference(before, after)
    if isinstance(before, tuple) and isinstance(after, tuple) and len(before) == len(after):
        return [_narrowed(a, b) for a, b in zip(before, after, strict=True) if a != b]
    return (before, after) if not isinstance(before, bytes) else "other bytes"
