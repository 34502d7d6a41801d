# SPDX-License-Identifier: GPL-3.0-or-later
"""The node hook-up: shows a baked normal map in the materials of the low mesh, by the wires a person would draw.

Image Texture -> Normal Map -> the Normal input of every shader that reaches the material's output, underneath the Bump
nodes that stand in between. Baking again finds the same nodes and changes pixels, not wires. No node is ever removed,
and what is not understood is left as it is and told in a note.
"""

from collections import defaultdict
from dataclasses import dataclass, field

import bpy
import numpy as np

from ..core.errors import BakeError

# A custom property on our nodes and on the images that we have baked. Names and labels are for people, who may change
# them; the mark outlives renaming, copying and saving, so that a later bake knows what it may set anew.
MARK = "imprint"
NODE_HEIGHT = 320  # room for one node in a column: Blender knows the real height only once a window has drawn it
NODE_GAP = 60
CONVENTIONS = {("+X", "+Y", "+Z"): "OPENGL", ("+X", "-Y", "+Z"): "DIRECTX"}


@dataclass
class _Job:
    """One material: what it shall show, what is in its tree, and what there is to say about it."""

    material: bpy.types.Material
    image: bpy.types.Image
    settings: dict  # of the Normal Map node
    uv_layer: str
    layer_names: tuple  # by which nodes know the layer: "" or no node at all stands for the render-active one
    links: dict = field(default_factory=dict)  # by input socket: socket.links would walk through the whole tree
    own: dict = field(default_factory=dict)  # our nodes by type; one of each serves all shaders of a material
    notes: dict = field(default_factory=dict)  # an ordered set: two shaders may meet one obstacle

    def say(self, text):
        self.notes[f'Material "{self.material.name}": {text}'] = None

    def leave(self, node, what, source, kind):
        muted = ", muted or in a circle" if kind == "muted" else ""
        self.say(f"{_title(node)} takes its {what} from {_title(source)}{muted}, which was left as it is.")


def check(low):
    """Raise BakeError where hook_up could do nothing at all, so that a person hears of it before the bake."""
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
    """Show image as the normal map of every material that low's faces can show; return notes for the report.

    space is 'TANGENT', 'OBJECT' or 'WORLD'; channels are what red, green and blue hold, as in Settings. With single_user,
    a material that is linked from a library or shown by other objects too is first copied for low.
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
    """Whether edits last: an override of a mesh or material forgets new slots and nodes when the file is loaded."""
    return datablock.is_editable and not datablock.override_library


def _fill_slots(low, single_user):
    """Put one new material into every slot that low's faces use and that has none."""
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
    """Put material into slot: on the object where the mesh cannot hold it, or would show it on other objects too."""
    if slot.link == "DATA" and (not _is_local(low.data) or (single_user and low.data.users > 1)):
        slot.link = "OBJECT"
    slot.material = material


def _sharers(low):
    """The names of the objects besides low that show each material."""
    sharers = defaultdict(list)
    for obj in bpy.data.objects:
        if obj != low and obj.users:  # without users it is in no scene: deleted, but not purged yet
            for material in {slot.material for slot in obj.material_slots}:
                sharers[material].append(obj.name)
    return sharers


def _list(names):
    few = ", ".join(f'"{name}"' for name in names[:3]) + (", ..." if len(names) > 3 else "")
    return f"is also on {len(names)} other object{'s' if len(names) > 1 else ''} ({few})"


def _hook_material(job):
    """Bring the map to every shader that the material's surface is made of."""
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
            job.say(f"the group {_title(shader)} has no Normal input, so the map does not reach the shaders in it.")
    if not done:
        job.say("no shader with a Normal input reaches the output, so the map is not shown.")


def _shaders(job):
    """The nodes with a shader output from which the Material Output of any engine takes its surface."""
    tree = job.material.node_tree
    outputs = [output for output in map(tree.get_output_node, ("ALL", "EEVEE", "CYCLES")) if output]
    waiting = [output.inputs["Surface"] for output in outputs or [_new_output(job)]]
    nodes = {}  # an ordered set
    while waiting:
        _, node, _ = _trace(job, waiting.pop())
        if node and node not in nodes:  # the muted ones too: they may come back
            nodes[node] = None
            waiting += node.inputs  # all of them: Shader to RGB makes colors of shaders
    return [node for node in nodes if any(socket.type == "SHADER" for socket in node.outputs)]


def _new_output(job):
    """A Material Output with a Principled BSDF, to the right of all that is there."""
    tree = job.material.node_tree
    right = max((node.location_absolute.x + node.width for node in tree.nodes), default=0)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = right + 2 * NODE_GAP + 240, 100
    principled = tree.nodes.new("ShaderNodeBsdfPrincipled")
    _place(job, principled, output)
    _connect(job, principled.outputs["BSDF"], output.inputs["Surface"])
    job.say("it had no Material Output; one was added, with a Principled BSDF.")
    return output


def _trace(job, socket):
    """Walk back from an input through reroutes: the last input on the way, the node that feeds it, and "type.output".

    Nothing coming in gives None for node and kind; a wire or node that passes nothing on is of the kind "muted".
    """
    while link := job.links.get(socket):
        node = link.from_node
        # Blender calls one link in every circle invalid, unless a single node feeds itself.
        if link.is_muted or node.mute or not link.is_valid or node == link.to_node:
            return socket, node, "muted"
        if node.bl_idname != "NodeReroute":
            return socket, node, f"{node.bl_idname}.{link.from_socket.identifier}"
        socket = node.inputs[0]
    return socket, None, None


def _feed_normal(job, shader, normal, done):
    """Bring the map to a shader's Normal input, or to the lowest Bump node of those that feed it."""
    while normal not in done:  # else another shader came this way
        done.add(normal)
        end, node, kind = _trace(job, normal)
        if kind == "ShaderNodeBump.Normal":
            normal = node.inputs["Normal"]
        elif kind in (None, "ShaderNodeNormalMap.Normal"):
            _feed_normal_map(job, node or _own(job, "ShaderNodeNormalMap", "Normal", end))
        else:
            job.leave(shader, "Normal", node, kind)


def _feed_normal_map(job, normal_map):
    """Make a Normal Map node show the image, where its color comes from an Image Texture or from nowhere."""
    color = normal_map.inputs["Color"]
    end, texture, kind = _trace(job, color)
    if kind not in (None, "ShaderNodeTexImage.Color"):
        return job.leave(normal_map, "Color", texture, kind)
    if texture and _is_foreign(texture.image):
        job.say(
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
        return job.leave(texture, "Vector", node, kind)
    if node and not node.get(MARK):
        if node.uv_map in job.layer_names:
            return None
        job.say(
            f'{_title(texture)} no longer uses the UV map "{node.uv_map}"; {_title(node)}, which names it, is kept.'
        )
        node, end = None, vector
    return _set(node or _own(job, "ShaderNodeUVMap", "UV", end), uv_map=job.uv_layer)


def _own(job, kind, output, socket):
    """Our node of this kind, made where there is none yet, connected to socket."""
    if kind not in job.own:
        node = job.own[kind] = job.material.node_tree.nodes.new(kind)
        node[MARK] = True
        node.name = node.label = f"Imprint {node.bl_label}"
        _place(job, node, socket.node)
    _connect(job, job.own[kind].outputs[output], socket)
    return job.own[kind]


def _place(job, node, left_of):
    """Move a new node into the first free place to the left of another, in the same frame, unselected."""
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
    """Set what differs: writing even the same value makes the viewport compile the material again."""
    for name, value in values.items():
        if getattr(datablock, name) != value:
            setattr(datablock, name, value)


def _title(node):
    return f'"{node.label or node.name}"'
