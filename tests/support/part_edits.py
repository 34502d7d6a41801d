# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of all kinds of objects, and edits of them, by which signs are compared with fresh bakes."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import bpy
import numpy as np
from mathutils import Matrix

from addon.core.declarations.all_settings import DECLARED
from addon.core.errors import BakeError
from addon.core.progress import finish
from addon.core.settings import PART_OF, Settings
from addon.jobs import Job, bake_jobs, part_state
from addon.ui import object_pairs
from tests.support import geometry_nodes, scenes, zoo

SMALL = {"width": 16, "height": 16, "margin": 2, "rays": 16, "maps": ("BASE_COLOR", "HEIGHT"), "method": "CAST"}
LOW, HIGH = "brick_low", "brick_high"


@dataclass
class Part:
    """A part with the settings of its bakes.

    Attributes:
        folder: Of its textures.
        empty: The path of an empty file.
    """

    kind: str
    folder: Path
    empty: str = ""
    settings: Settings = field(default_factory=lambda: Settings(**SMALL))

    @property
    def texture(self) -> Path:
        """The file of the image that its high object shows."""
        return self.folder / "bricks.png"

    def object(self, role: str) -> bpy.types.Object:
        """The object of a role, LOW or HIGH, whatever it is called."""
        found = [obj for obj in bpy.data.objects if obj.get("role") == role]
        return min(found, key=lambda obj: obj.library is not None)

    @property
    def job(self) -> Job:
        low, high = self.object(LOW), self.object(HIGH)
        return Job(low, [high])

    def bake(self) -> list[np.ndarray]:
        """The maps of a fresh bake, which the low object remembers."""
        (report,) = bake_jobs.bake_all(bpy.context, [self.job], self.settings)
        object_pairs.remember([report])
        return [_texels(name) for name in report.state.of_kind("image")]

    def changes(self) -> list[str]:
        """What the sign says: what changed since the last bake."""
        job = self.job
        then = part_state.kept(job.low)
        now = finish(part_state.look(bpy.context, job, self.settings, then=then))
        with mock.patch.object(part_state, "_as_shown", lambda _context, request: request):  # as a bake reads
            again = finish(part_state.look(bpy.context, job, self.settings, then=then))
        # Of an override, Blender may update the modifiers while it is read.
        is_override = any(obj.override_library for obj in (job.low, *job.highs))
        assert now.pieces == again.pieces or is_override or not part_state.changes(now, again)
        return part_state.changes(then, now)


def _texels(name: str) -> np.ndarray:
    image = bpy.data.images[name]
    texels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(texels)
    return texels.reshape(*image.size, -1)


def is_same(before: list[np.ndarray], after: list[np.ndarray]) -> bool:
    """Whether both have the same maps, to the bit."""
    return len(before) == len(after) and all(map(np.array_equal, before, after))


# Kinds of objects


def new_file(empty: str) -> None:
    bpy.ops.wm.read_homefile(filepath=empty, use_empty=True)


def write_texture(path: Path, seed: int) -> None:
    """A texture of random colors."""
    rng = np.random.default_rng(seed)
    image = bpy.data.images.new("made", 8, 8)
    texels = np.ones((8, 8, 4), np.float32)
    texels[..., :3] = rng.integers(0, 256, (8, 8, 3)) / 255.0
    image.pixels.foreach_set(texels.ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


def make(kind: str, folder: Path, seed: int, empty: str = "") -> Part:
    """A part of a kind in the open file, which is empty."""
    folder.mkdir(parents=True, exist_ok=True)
    part = Part(kind, folder, empty)
    write_texture(part.texture, seed)
    low = zoo.terrain(LOW, 3, height=0.05)
    scenes.move_uvs(low, (0.8, 0.8), (0.1, 0.1))
    low.scale = (1.15, 1.15, 1.0)
    low["role"] = LOW
    high = KINDS[kind](part)
    high["role"] = HIGH
    bpy.context.view_layer.update()
    return part


def _terrain(part: Part, name=HIGH) -> bpy.types.Object:
    high = zoo.terrain(name, 12, height=0.15)
    _paint(part, high)
    return high


def _paint(part: Part, high: bpy.types.Object) -> None:
    """Give an object a material with the texture."""
    shown = bpy.data.images.load(str(part.texture))
    made = scenes.material("bricks", high)
    node = scenes.texture(made, shown)
    scenes.set_inputs(made, Base_Color=node.outputs["Color"])


def _with_modifiers(part: Part) -> bpy.types.Object:
    high = _terrain(part)
    high.modifiers.new("Subdivision", "SUBSURF")
    wave = high.modifiers.new("Displace", "DISPLACE")
    wave.texture = bpy.data.textures.new("clouds", "CLOUDS")
    wave.strength = 0.1
    high.modifiers.new("Bevel", "BEVEL").show_render = False
    return high


def _multires(part: Part) -> bpy.types.Object:
    high = _terrain(part)
    modifier = high.modifiers.new("Multires", "MULTIRES")
    with bpy.context.temp_override(object=high, active_object=high):
        for _ in range(2):
            bpy.ops.object.multires_subdivide(modifier=modifier.name, mode="CATMULL_CLARK")
    return high


def _curve(part: Part) -> bpy.types.Object:
    data = bpy.data.curves.new("rope", "CURVE")
    data.dimensions, data.bevel_depth = "3D", 0.3
    spline = data.splines.new("POLY")
    spline.points.add(3)
    for point, x in zip(spline.points, (-1.0, -0.3, 0.3, 1.0), strict=True):
        point.co = (x, 0.2 * x, 0.1, 1.0)
    obj = scenes.link(bpy.data.objects.new(HIGH, data))
    scenes.material("plain", obj, Base_Color=(0.5, 0.2, 0.1))
    return obj


def _text(part: Part) -> bpy.types.Object:
    data = bpy.data.curves.new("word", "FONT")
    data.body, data.extrude, data.align_x = "AB", 0.1, "CENTER"
    obj = scenes.link(bpy.data.objects.new(HIGH, data))
    scenes.material("plain", obj, Base_Color=(0.1, 0.2, 0.6))
    return obj


def _instances(part: Part) -> bpy.types.Object:
    stone = zoo.ball("stone", 6)
    stone.scale = (0.4, 0.4, 0.2)
    stone.location.z = -30.0
    _paint(part, stone)
    high = zoo.plane(HIGH, 2)
    scenes.material("ground", high, Base_Color=(0.2, 0.3, 0.1))
    tree = geometry_nodes.Tree(high)
    points = tree.add("GeometryNodeMeshToPoints", {0: tree.geometry})
    stones = tree.add("GeometryNodeInstanceOnPoints", {"Points": points, "Instance": tree.object(stone)})
    tree.end(tree.add("GeometryNodeJoinGeometry", {0: [tree.geometry, stones]}))
    return high


def _collection(part: Part) -> bpy.types.Object:
    inner = _terrain(part, "inner")
    group = bpy.data.collections.new("group")
    group.objects.link(inner)
    bpy.context.scene.collection.objects.unlink(inner)
    obj = scenes.link(bpy.data.objects.new(HIGH, None))
    obj.instance_type, obj.instance_collection = "COLLECTION", group
    return obj


def _character(part: Part) -> bpy.types.Object:
    high = _terrain(part)
    scenes.weigh(high, "bone", 1.0)
    rig = scenes.link(bpy.data.objects.new("rig", bpy.data.armatures.new("rig")))
    with bpy.context.temp_override(object=rig, active_object=rig):
        bpy.context.view_layer.objects.active = rig
        bpy.ops.object.mode_set(mode="EDIT")
        bone = rig.data.edit_bones.new("bone")
        bone.head, bone.tail = (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        bpy.ops.object.mode_set(mode="OBJECT")
    high.modifiers.new("Armature", "ARMATURE").object = rig
    return high


def _keys(part: Part) -> bpy.types.Object:
    high = _terrain(part)
    high.shape_key_add(name="Basis")
    for name in ("bump", "unused"):
        key = high.shape_key_add(name=name)
        key.data[40].co.z += 0.2
        key.value = 0.0 if name == "unused" else 0.5
    return high


def _noise(part: Part) -> bpy.types.Object:
    high = _terrain(part)
    tree = high.data.materials[0].node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    tree.links.new(noise.outputs[0], ramp.inputs[0])
    scenes.set_inputs(high.data.materials[0], Base_Color=ramp.outputs["Color"])
    return high


def _override(part: Part) -> bpy.types.Object:
    high = _with_modifiers(part)
    high["role"] = HIGH
    path = str(part.folder / "library.blend")
    bpy.data.libraries.write(path, {high})
    bpy.data.batch_remove([high, *bpy.data.materials, *bpy.data.textures, *bpy.data.images])
    (linked,) = scenes.from_library(path, "objects", HIGH)
    return linked.override_create(remap_local_usages=True)


KINDS: dict[str, Callable[[Part], bpy.types.Object]] = {
    "modifiers": _with_modifiers,
    "multires": _multires,
    "curve": _curve,
    "text": _text,
    "instances": _instances,
    "collection": _collection,
    "character": _character,
    "shape keys": _keys,
    "noise": _noise,
    "override": _override,
}


# Edits. Each returns what it did in words, or "" if the part has nothing of that kind.


def _any(rng, items):
    items = list(items)
    return items[rng.integers(len(items))] if items else None


def _mesh(part: Part, rng) -> str:
    obj = _any(rng, [obj for obj in bpy.data.objects if obj.data is not None and obj.data.library is None])
    if obj is None:
        return ""
    data = obj.data
    if isinstance(data, bpy.types.TextCurve):
        data.body = _any(rng, ("AB", "AC", "X", "AB"))
        return f"text of {obj.name}: {data.body}"
    if isinstance(data, bpy.types.Curve):
        _any(rng, data.splines[0].points).co.z += float(rng.normal() * 0.05)
        return "point of the curve"
    if not isinstance(data, bpy.types.Mesh):
        return ""
    match rng.integers(6):
        case 0 | 1:
            vertex = _any(rng, data.vertices)
            vertex.co.z += float(rng.normal() * 0.05)
            what = f"vertex {vertex.index}"
        case 2:
            for each in data.uv_layers[0].uv if data.uv_layers else ():
                each.vector *= 0.95
            what = "UVs"
        case 3:
            _any(rng, data.polygons).use_smooth = bool(rng.integers(2))
            what = "smooth face"
        case 4:
            if "paint" not in data.color_attributes:
                data.color_attributes.new("paint", "BYTE_COLOR", "CORNER")
            data.color_attributes["paint"].data[0].color = (*rng.random(3), 1.0)
            what = "vertex color"
        case 5:
            name = "Other"
            if name not in data.uv_layers:
                data.uv_layers.new(name=name, do_init=True)
            data.uv_layers[name].uv[0].vector.x += 0.1
            what = "another UV map"
    data.update()
    return f"{what} of {obj.name}"


def _modifier(part: Part, rng) -> str:
    obj = part.object(_any(rng, (HIGH, HIGH, LOW)))
    modifier = _any(rng, obj.modifiers)
    if modifier is None or rng.random() < 0.2:
        if obj.type != "MESH":
            return ""
        added = obj.modifiers.new("Added", _any(rng, ("TRIANGULATE", "SMOOTH", "WEIGHTED_NORMAL", "SUBSURF")))
        return f"{added.type} added to {obj.name}"
    match rng.integers(4):
        case 0:
            modifier.show_viewport = not modifier.show_viewport
            return f"{modifier.name} in viewports: {modifier.show_viewport}"
        case 1:
            modifier.show_render = not modifier.show_render
            return f"{modifier.name} in renders: {modifier.show_render}"
        case 2:
            modifier.name = f"renamed {rng.integers(100)}"
            return "modifier renamed"
    match modifier.type:
        case "DISPLACE":
            modifier.strength += float(rng.normal() * 0.05)
        case "SUBSURF":
            name = _any(rng, ("levels", "render_levels"))
            setattr(modifier, name, int(rng.integers(0, 3)))
            return f"{name} of subdivision"
        case "BEVEL":
            modifier.width += 0.01
        case "MULTIRES":
            name = _any(rng, ("levels", "render_levels", "sculpt_levels"))
            setattr(modifier, name, int(rng.integers(0, 3)))
            return f"{name} of multires"
        case _:
            return ""
    return f"{modifier.type} of {obj.name}"


def _shape_key(part: Part, rng) -> str:
    high = part.object(HIGH)
    keys = getattr(high.data, "shape_keys", None)
    if keys is None:
        return ""
    key = _any(rng, keys.key_blocks[1:])
    match rng.integers(3):
        case 0:
            key.value = float(rng.random())
        case 1:
            _any(rng, key.data).co.z += 0.1
        case 2:
            key.mute = not key.mute
    return f"shape key {key.name}"


def _pose(part: Part, rng) -> str:
    rig = next((obj for obj in bpy.data.objects if obj.type == "ARMATURE"), None)
    if rig is None:
        return ""
    bone = rig.pose.bones[0]
    bone.rotation_mode = "XYZ"
    match rng.integers(3):
        case 0:
            bone.rotation_euler.x += float(rng.normal() * 0.1)
        case 1:
            bone.color.palette = _any(rng, ("THEME01", "THEME02"))
        case 2:
            rig.data.pose_position = _any(rng, ("POSE", "REST"))
    return "pose"


def _material(part: Part, rng) -> str:
    made = _any(rng, [each for each in bpy.data.materials if each.library is None])
    if made is None:
        return ""
    tree = made.node_tree
    inputs = tree.nodes["Principled BSDF"].inputs
    match rng.integers(7):
        case 0 | 1:
            name = _any(rng, ("Roughness", "Coat Weight"))
            inputs[name].default_value = float(rng.random())
            return name
        case 2:
            inputs["Base Color"].default_value = (*rng.random(3), 1.0)
            return "base color, perhaps under a link"
        case 3:
            tree.nodes.new("ShaderNodeRGB").outputs[0].default_value = (*rng.random(3), 1.0)
            return "a node without a link"
        case 4:
            made.diffuse_color = (*rng.random(3), 1.0)
            for node in tree.nodes:
                node.location.x += 10.0
            return "nodes moved"
    return _node(
        _any(rng, [one for one in tree.nodes if one.bl_idname.startswith(("ShaderNodeTex", "ShaderNodeVal"))]), rng
    )


def _node(node: bpy.types.Node | None, rng) -> str:
    """Change a node of a material."""
    if node is None:
        return ""
    if node.bl_idname == "ShaderNodeTexImage":
        match rng.integers(3):
            case 0:
                node.interpolation = _any(rng, ("Linear", "Closest"))
            case 1 if not node.image.get("imprint_map"):  # which would be an edit of a map
                node.image.colorspace_settings.name = _any(rng, ("sRGB", "Non-Color"))
            case _:
                node.extension = _any(rng, ("REPEAT", "EXTEND", "CLIP"))
    elif node.bl_idname == "ShaderNodeValToRGB":
        node.color_ramp.elements[0].color = (*rng.random(3), 1.0)
    else:
        node.inputs["Scale"].default_value += float(rng.random())
    return f"value of {node.bl_idname}"


def _file(part: Part, rng) -> str:
    match rng.integers(4):
        case 0 | 1:
            write_texture(part.texture, int(rng.integers(1 << 30)))
            return "texture written anew"
        case 2:
            content = part.texture.read_bytes()
            part.texture.unlink()
            part.texture.write_bytes(content)
            return "texture written as it was"
    os.utime(part.texture)
    return "texture touched"


OTHER_TEXTS = {
    "image": ("", "T_{low}_N", "other"),
    "offset_group": ("",),
    "straight_group": ("",),
    "attribute": ("paint",),
}
MAPS = (
    ("BASE_COLOR",),
    ("BASE_COLOR", "AO"),
    ("HEIGHT", "CURVATURE"),
    ("OBJECT_ID", "BASE_COLOR"),
    ("BASE_COLOR", "HEIGHT"),
)
NOT_TRIED = {
    *("output", "storage", "tiles", "udim", "width", "height", "uv_layer", "vertex_domain", "one_material", "limit"),
    *("texture_sets", "targets", "low_suffix", "mip_files", "rays"),
}
"""Settings that need files, tiles, groups or others beside them, and those that take long."""


def _setting(part: Part, rng) -> str:
    name = _any(rng, [name for name in PART_OF if name not in NOT_TRIED])
    setting, now = DECLARED[name], part.settings.flat()[name]
    if name == "maps":
        value = MAPS[rng.integers(len(MAPS))]
    elif name in OTHER_TEXTS:
        value = _any(rng, OTHER_TEXTS[name])
    elif isinstance(now, bool):
        value = not now
    elif hasattr(setting, "items"):
        value = _any(rng, [item.value for item in setting.items])
    elif isinstance(now, int):
        value = now + 1 if name != "depth" else _any(rng, (8, 16))
    elif isinstance(now, tuple):
        value = tuple(float(each) for each in rng.random(3))
    else:
        value = float(rng.random())
    part.settings = with_value(part.settings, name, value)
    return f"{name}: {now} to {value}"


def with_value(settings: Settings, name: str, value: object) -> Settings:
    """Settings with one of another value."""
    return Settings(**settings.flat() | {name: value})


def _rename(part: Part, rng) -> str:
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.images, bpy.data.textures)
    block = _any(
        rng, [block for kind in kinds for block in kind if block.library is None and not block.override_library]
    )
    before, block.name = block.name, f"name {rng.integers(1000)}"
    return f"{before} to {block.name}"


def _parent(part: Part, rng) -> str:
    obj = part.object(_any(rng, (HIGH, LOW)))
    if obj.parent is None:
        obj.parent = scenes.link(bpy.data.objects.new("parent", None))
        if rng.random() < 0.5:
            obj.parent.location = rng.normal(size=3) * 0.1
            bpy.context.view_layer.update()
            obj.matrix_parent_inverse = obj.parent.matrix_world.inverted()
        return f"{obj.name} got a parent"
    obj.parent.location.z += float(rng.choice([0.0, 0.02]))
    return f"parent of {obj.name} moved"


def _move(part: Part, rng) -> str:
    low, high = part.object(LOW), part.object(HIGH)
    by = Matrix.Translation(rng.normal(size=3) * 0.05)
    match rng.integers(6):
        case 0:
            high.location.z += 0.01
            return "high moved"
        case 1:
            low.location.x += 0.02
            return "low moved"
        case 2:
            high.rotation_euler.z += 0.1
            return "high turned"
        case 3:
            other = scenes.link(bpy.data.objects.new("other", None))
            other.location.x = 3.0
            return "another object moved"
        case 4:
            how = "both turned"
            by = Matrix.Rotation(0.3, 4, "Z")
        case 5:
            how = "both moved"
    for obj in (low, high):
        if obj.parent is None:
            obj.matrix_basis = by @ obj.matrix_basis
    return how


def _unit(part: Part, rng) -> str:
    units = bpy.context.scene.unit_settings
    match rng.integers(3):
        case 0:
            units.system = _any(rng, ("NONE", "METRIC", "IMPERIAL"))
        case 1:
            units.scale_length = float(_any(rng, (1.0, 0.01, 2.0)))
        case 2:
            units.system_rotation = _any(rng, ("DEGREES", "RADIANS"))
    return "units"


def _nothing(part: Part, rng) -> str:
    match rng.integers(6):
        case 5:
            for image in bpy.data.images:
                len(image.pixels)
                image.update()
            return "images loaded"
        case 0:
            bpy.context.scene.frame_set(int(rng.integers(1, 50)))
            return "frame"
        case 1:
            high = part.object(HIGH)
            high.hide_set(not high.hide_get())
            return "hidden or shown"
        case 2:
            zoo.plane("new", 2).location.x = 5.0
            return "new object"
        case 3:
            part.object(HIGH).select_set(True)
            bpy.context.scene.render.resolution_x += 1
            return "resolution"
    return "nothing"


EDITS: dict[str, Callable] = {
    "mesh": _mesh,
    "modifier": _modifier,
    "shape key": _shape_key,
    "pose": _pose,
    "material value": _material,
    "texture file": _file,
    "setting": _setting,
    "rename": _rename,
    "parent": _parent,
    "move": _move,
    "unit": _unit,
    "nothing": _nothing,
}


# What happens between an edit and the look


def _save(part: Part) -> str:
    return scenes.save(
        part.folder / f"part{len(list(part.folder.iterdir()))}.blend"
    )  # libraries are not to be overwritten


def _reopened(part: Part) -> None:
    open_again(part.folder)


def open_again(folder: Path) -> None:
    """Save the open file in a folder, and open it."""
    path = scenes.save(folder / f"part{len(list(folder.iterdir()))}.blend")
    bpy.ops.wm.open_mainfile(filepath=path)


def _appended(part: Part, *, link: bool = False) -> None:
    objects = [part.object(role) for role in (LOW, HIGH)]
    if any(obj.library for obj in objects):
        return
    names, path = [obj.name for obj in objects], _save(part)
    new_file(part.empty)
    with bpy.data.libraries.load(path, link=link) as (_, here):
        here.objects = names
    for obj in here.objects:
        scenes.link(obj)


def _overridden(part: Part) -> None:
    if any(part.object(role).override_library for role in (LOW, HIGH)):
        return
    _appended(part, link=True)
    part.object(LOW).override_create(remap_local_usages=True)


def _undone(_part: Part) -> None:
    if bpy.data.libraries:  # Blender 5.2 crashes at Redo in the background
        return
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()


def _redone(part: Part) -> None:
    _undone(part)
    if not bpy.data.libraries:
        bpy.ops.ed.redo()


WAYS: dict[str, Callable[[Part], None]] = {
    "at once": lambda _part: None,
    "saved and opened": _reopened,
    "appended": _appended,
    "overridden": _overridden,
    "undone": _undone,
    "redone": _redone,
}


@dataclass(frozen=True)
class Judged:
    """An edit, whether the maps are stale then, and what the sign said."""

    kind: str
    edit: str
    did: str
    is_stale: bool
    clauses: list[str]

    @property
    def is_missed(self) -> bool:
        """Whether a stale map was called true."""
        return self.is_stale and not self.clauses

    @property
    def is_alarm(self) -> bool:
        """Whether a true map was called changed."""
        return not self.is_stale and bool(self.clauses)


def judge(part: Part, edit: str, rng, before: list[np.ndarray], way: str = "at once"):
    """Edit a part, look at it, and bake it anew. way: what happens between the edit and the look.

    Returns what came of it, and the new maps; None if the part has nothing to edit like that, or cannot be baked any more.
    """
    settings = part.settings
    if way in {"undone", "redone"}:
        bpy.ops.ed.undo_push(message="before")
    did = EDITS[edit](part, rng)
    if not did:
        return None, before
    bpy.context.view_layer.update()
    WAYS[way](part)
    did += f", {way}"
    bpy.context.view_layer.update()
    clauses = part.changes()
    try:
        after = part.bake()
    except BakeError as error:
        if not clauses:
            return Judged(part.kind, edit, f"{did}: {error}", True, clauses), before
        part.settings = settings
        return None, None
    is_elsewhere = did.startswith("image:") and settings != part.settings  # whatever the maps show
    return Judged(part.kind, edit, did, is_elsewhere or not is_same(before, after), clauses), after
