# SPDX-License-Identifier: GPL-3.0-or-later
"""Connects a baked normal map to the materials of the low mesh, with the nodes and links that an artist would use.

Image Texture -> Normal Map -> the Normal input of every shader that reaches the output, below any Bump nodes in between.
Baking again reuses these nodes. No node is ever removed. Node setups that are not recognized stay unchanged, with a note.
"""

from collections import defaultdict
from dataclasses import dataclass, field

import bpy
import numpy as np

from ..core.errors import BakeError

# A custom property on the nodes and images that Imprint created. Artists may rename nodes; the mark survives renaming,
# copying and saving, so that a later bake recognizes the nodes that it may change.
MARK = "imprint"
NODE_HEIGHT = 320  # the space for one node in a column: Blender knows the real height only after drawing it in a window
NODE_GAP = 60
CONVENTIONS = {("+X", "+Y", "+Z"): "OPENGL", ("+X", "-Y", "+Z"): "DIRECTX"}


@dataclass
class _Job:
    """The hook-up of one material: its target image and settings, the state of its node tree, and the notes."""

    material: bpy.types.Material
    image: bpy.types.Image
    settings: dict  # of the Normal Map node
    uv_layer: str
    layer_names: (
        tuple  # the names that nodes use for the UV layer: "", or no node at all, means the render-active layer
    )
    links: dict = field(default_factory=dict)  # by input socket: socket.links searches the whole tree
    own: dict = field(default_factory=dict)  # nodes that Imprint created, by type; all shaders of a material share them
    notes: dict = field(default_factory=dict)  # an ordered set: two shaders can lead to the same note

    def note(self, text):
        self.notes[f'Material "{self.material.name}": {text}'] = None

    def note_unchanged(self, node, what, source, kind):
        muted = ", muted or in a circle" if kind == "muted" else ""
        self.note(f"{_title(node)} takes its {what} from {_title(source)}{muted}, which was left as it is.")


def check(low):
    """Raise BakeError if hook_up cannot change anything, so that the bake does not start."""
    if not low.is_editable:
        raise BakeError(
            f'"{low.name}" is linked from a library, so its materials cannot be set: make it local first, '
            "or switch Material off (--no-material)."
        )
    if not low.material_slots and not _is_local(low.data):
        raise BakeError(
            f'"{low.name}" has no material, and its mesh "{low.data.name}" is linked from a library and cannot be '
            "given one: make the mesh local first."
        )


def hook_up(low, image, *, space, uv_layer, channels, single_user=False):
    """Show the image as the normal map of every material on the faces of low. Returns notes for the report.

    space: 'TANGENT', 'OBJECT' or 'WORLD'. channels: the axes in red, green and blue, as in Settings. single_user: first copy
    materials that are linked from a library or used by other objects.
    """
    image[MARK] = True
    if channels not in CONVENTIONS:
        return [f"No Normal Map node reads channels of {', '.join(channels)}: the material was left as it is."]
    settings = {"space": space, "convention": CONVENTIONS[channels]}
    if space == "TANGENT":
        settings["uv_map"] = uv_layer
    is_default = any(layer.name == uv_layer and layer.active_render for layer in low.data.uv_layers)
    layer_names = (uv_layer, "") if is_default else (uv_layer,)

    _fill_slots(low, single_user)
    sharers = _sharers(low)
    notes = []
    for material in dict.fromkeys(slot.material for slot in low.material_slots if slot.material):
        is_local, others = _is_local(material), sharers[material]
        state = f'Material "{material.name}" ' + (_list(others) if is_local else "is linked from a library")
        target = material
        if single_user and (others or not is_local):
            target = _copy_for(low, material)
            notes.append(f'{state}; "{low.name}" has a copy of its own now, "{target.name}".')
        elif not is_local:
            notes.append(f"{state} and was left as it is; make it local, or ask for a single-user copy.")
            continue
        elif others:
            notes.append(f"{state}; the map shows there too.")
        job = _Job(target, image, settings, uv_layer, layer_names)
        _hook_material(job)
        notes.extend(job.notes)
    return notes


def _is_local(datablock):
    """Whether edits are saved: a library override of a mesh or material loses new slots and nodes when a file is loaded."""
    return datablock.is_editable and not datablock.override_library


def _fill_slots(low, single_user):
    """Put one new material into all empty slots that the faces of low use."""
    if not low.material_slots:
        low.data.materials.append(None)
    slots = low.material_slots
    if all(slot.material for slot in slots):
        return
    faces = np.empty(len(low.data.polygons), dtype=np.int32)
    low.data.polygons.foreach_get("material_index", faces)
    used = np.unique(faces.clip(0, len(slots) - 1))  # a face whose index is too high shows the last slot
    bare = [slots[i] for i in used.tolist() if not slots[i].material]
    if bare:
        material = bpy.data.materials.new(low.name)
        for slot in bare:
            _assign(low, slot, material, single_user)


def _copy_for(low, material):
    copy = material.copy()
    copy.make_local()  # the copy of a library override is an override too
    for slot in low.material_slots:
        if slot.material == material:
            _assign(low, slot, copy, True)
    return copy


def _assign(low, slot, material, single_user):
    """Put the material into the slot. Link it to the object if the mesh cannot be changed, or other objects share it."""
    if slot.link == "DATA" and (not _is_local(low.data) or (single_user and low.data.users > 1)):
        slot.link = "OBJECT"
    slot.material = material


def _sharers(low):
    """The names of the other objects that use each material."""
    sharers = defaultdict(list)
    for obj in bpy.data.objects:
        if obj != low and obj.users:  # an object without users was deleted, but not purged yet
            for material in {slot.material for slot in obj.material_slots}:
                sharers[material].append(obj.name)
    return sharers


def _list(names):
    listed = ", ".join(f'"{name}"' for name in names[:3]) + (", ..." if len(names) > 3 else "")
    return f"is also on {len(names)} other object{'s' if len(names) > 1 else ''} ({listed})"


def _hook_material(job):
    """Connect the map to every shader of the material's surface."""
    job.links = {link.to_socket: link for link in job.material.node_tree.links}
    for node in job.material.node_tree.nodes:
        is_texture = node.bl_idname == "ShaderNodeTexImage"
        if node.get(MARK) and not node.mute and not (is_texture and _is_foreign(node.image)):
            job.own.setdefault(node.bl_idname, node)
    done = set()
    for shader in _shaders(job):
        normal = next((s for s in shader.inputs if s.name == "Normal" and s.type == "VECTOR" and s.enabled), None)
        if normal:
            _feed_normal(job, shader, normal, done)
        elif shader.bl_idname == "ShaderNodeGroup":
            job.note(f"the group {_title(shader)} has no Normal input, so the map does not reach the shaders in it.")
    if not done:
        job.note("no shader with a Normal input reaches the output, so the map is not shown.")


def _shaders(job):
    """The shader nodes that reach the surface of the Material Output of any render engine."""
    tree = job.material.node_tree
    outputs = [output for output in map(tree.get_output_node, ("ALL", "EEVEE", "CYCLES")) if output]
    waiting = [output.inputs["Surface"] for output in outputs or [_new_output(job)]]
    nodes = {}  # an ordered set
    while waiting:
        _, node, _ = _trace(job, waiting.pop())
        if node and node not in nodes:  # include muted nodes: the artist may unmute them
            nodes[node] = None
            waiting += node.inputs  # all inputs: Shader to RGB converts shaders to colors
    return [node for node in nodes if any(socket.type == "SHADER" for socket in node.outputs)]


def _new_output(job):
    """Add a Material Output with a Principled BSDF, to the right of all other nodes."""
    tree = job.material.node_tree
    right = max((node.location_absolute.x + node.width for node in tree.nodes), default=0)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = right + 2 * NODE_GAP + 240, 100
    principled = tree.nodes.new("ShaderNodeBsdfPrincipled")
    _place(job, principled, output)
    _connect(job, principled.outputs["BSDF"], output.inputs["Surface"])
    job.note("it had no Material Output; one was added, with a Principled BSDF.")
    return output


def _trace(job, socket):
    """Follow an input back through reroutes. Returns the last input, the node connected to it, and its kind, "type.output".

    An unconnected input gives None for node and kind. Muted nodes and links, and circles, are of the kind "muted".
    """
    while link := job.links.get(socket):
        node = link.from_node
        # Blender marks one link in every circle as invalid, unless a single node is connected to itself.
        if link.is_muted or node.mute or not link.is_valid or node == link.to_node:
            return socket, node, "muted"
        if node.bl_idname != "NodeReroute":
            return socket, node, f"{node.bl_idname}.{link.from_socket.identifier}"
        socket = node.inputs[0]
    return socket, None, None


def _feed_normal(job, shader, normal, done):
    """Connect the map to a shader's Normal input, or to the first Bump node of the chain connected to it."""
    while normal not in done:  # another shader may share the chain
        done.add(normal)
        end, node, kind = _trace(job, normal)
        if kind == "ShaderNodeBump.Normal":
            normal = node.inputs["Normal"]
        elif kind in (None, "ShaderNodeNormalMap.Normal"):
            _feed_normal_map(job, node or _own(job, "ShaderNodeNormalMap", "Normal", end))
        else:
            job.note_unchanged(shader, "Normal", node, kind)


def _feed_normal_map(job, normal_map):
    """Make a Normal Map node show the image, if its color comes from an Image Texture or is not connected."""
    color = normal_map.inputs["Color"]
    end, texture, kind = _trace(job, color)
    if kind not in (None, "ShaderNodeTexImage.Color"):
        return job.note_unchanged(normal_map, "Color", texture, kind)
    if texture and _is_foreign(texture.image):
        job.note(
            f'{_title(normal_map)} no longer shows "{texture.image.name}"; {_title(texture)}, which has it, is kept.'
        )
        texture, end = None, color
    texture = texture or _own(job, "ShaderNodeTexImage", "Color", end)
    _set(normal_map, **job.settings)
    _set(texture, image=job.image)
    return _feed_coordinates(job, texture)


def _feed_coordinates(job, texture):
    """Make an Image Texture read the UV layer that was baked."""
    vector = texture.inputs["Vector"]
    end, node, kind = _trace(job, vector)
    if "" in job.layer_names and kind in (None, "ShaderNodeTexCoord.UV"):
        return None
    if kind not in (None, "ShaderNodeUVMap.UV"):
        return job.note_unchanged(texture, "Vector", node, kind)
    if node and not node.get(MARK):
        if node.uv_map in job.layer_names:
            return None
        job.note(
            f'{_title(texture)} no longer uses the UV map "{node.uv_map}"; {_title(node)}, which names it, is kept.'
        )
        node, end = None, vector
    return _set(node or _own(job, "ShaderNodeUVMap", "UV", end), uv_map=job.uv_layer)


def _own(job, kind, output, socket):
    """Connect Imprint's own node of this kind to the socket, after adding it if there is none."""
    if kind not in job.own:
        node = job.own[kind] = job.material.node_tree.nodes.new(kind)
        node[MARK] = True
        node.name = node.label = f"Imprint {node.bl_label}"
        _place(job, node, socket.node)
    _connect(job, job.own[kind].outputs[output], socket)
    return job.own[kind]


def _place(job, node, left_of):
    """Move a new node to the first free place to the left of another node, in the same frame, and deselect it."""
    node.select = False
    node.parent = left_of.parent
    x, y = left_of.location_absolute
    x -= node.width + NODE_GAP
    others = [other for other in job.material.node_tree.nodes if other != node and other.bl_idname != "NodeFrame"]
    column = [other for other in others if x - other.width < other.location_absolute.x < x + node.width]
    for top in sorted((other.location_absolute.y for other in column), reverse=True):
        if abs(top - y) < NODE_HEIGHT:
            y = top - NODE_HEIGHT
    node.location_absolute = x, y


def _connect(job, output, socket):
    job.links[socket] = job.material.node_tree.links.new(output, socket)


def _is_foreign(image):
    return image is not None and not image.get(MARK)


def _set(datablock, **values):
    """Set the values that differ: writing an equal value would make the viewport compile the material again."""
    for name, value in values.items():
        if getattr(datablock, name) != value:
            setattr(datablock, name, value)


def _title(node):
    return f'"{node.label or node.name}"'
