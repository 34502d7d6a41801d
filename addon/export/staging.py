# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts triangulated copies of low objects, with copies of their materials and maps, into the open file for a short time."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from .. import older_blender
from ..core import udim
from ..core.errors import BakeError
from ..core.report import Report
from ..core.udim import FIRST
from ..output import datablocks, materials
from ..scene import mesh_writer
from .baked_low import BakedLow
from .map_pictures import PictureFiles

TANGENTS = "_IMPRINT_TANGENTS"
"""The attribute of staged meshes with the tangents of the bake. glTF's exporter writes attributes with such names."""
SHAPE_NORMALS = "_IMPRINT_NORMALS_"
"""What names of attributes begin with that have by how much a shape key moves normals; its number follows."""


@dataclass(frozen=True)
class Staged:
    """A low object that stands in the file.

    Attributes:
        uv (T, 3, 2): As the file gets them.
        textures: The material slot and the UDIM tile of each material; the tile is FIRST without UDIM.
        faces (T,): The texture of each triangle, whose order is that of the file.
        order (T,): Which triangle of `baked` each one is.
        name: Of the object, which is gone when the file is read back.
        notes: Sentences of what could not be shown in its materials.
    """

    baked: BakedLow
    object: bpy.types.Object
    name: str
    uv: np.ndarray
    textures: list[tuple[int, int]]
    faces: np.ndarray
    order: np.ndarray
    notes: list[str] = field(default_factory=list)

    def channels(self, texture: int) -> tuple[str, str, str]:
        """The axes that the bake's normal map of a texture stores."""
        settings = (self.baked.report_of(self.textures[texture][0]) or self.baked.reports[0]).settings
        return settings["red"], settings["green"], settings["blue"]


@dataclass(frozen=True)
class Stage:
    """All staged objects, in a collection of their own."""

    collection: bpy.types.Collection
    objects: list[Staged]


@contextmanager
def staged(
    context: bpy.types.Context,
    lows: Sequence[BakedLow],
    folder: Path,
    channels: Sequence[str] | None,
    *,
    with_tangents: bool,
    names_files: bool = False,
    before_names: str = "",
) -> Iterator[Stage]:
    """Stage low objects until the block ends. Then nothing of it is left in the file.

    folder: for the files of the maps. channels: the axes that the format's normal maps store, or None for those of the bake.
    with_tangents: whether meshes have the attributes TANGENTS and SHAPE_NORMALS, in glTF's axes. names_files: whether the
    format tells textures apart by the names of their files. before_names: what those names begin with. Raises BakeError.
    """
    made: list[bpy.types.ID] = []
    groups = set(bpy.data.node_groups)
    with ExitStack() as names:
        try:
            collection = bpy.data.collections.new("Imprint export")
            made.append(collection)
            context.scene.collection.children.link(collection)
            pictures = PictureFiles(folder, made, before_names)
            objects = []
            known: dict[tuple, bpy.types.Material] = {}
            done: set[bpy.types.Material] = set()
            armatures: dict[bpy.types.Object, bpy.types.Object] = {}
            for low in lows:
                objects.append(_object(low, made, names, known, with_tangents=with_tangents))
                collection.objects.link(objects[-1].object)
                _deform(objects[-1], collection, armatures, made, names)
                objects[-1].notes.extend(_with_maps(objects[-1], pictures, channels, done))
                if names_files:
                    _name_textures(objects[-1], pictures)
            context.view_layer.update()
            yield Stage(collection, objects)
        finally:  # before names are given back
            _remove(made, groups)


def _remove(made: Sequence[bpy.types.ID], groups: set[bpy.types.NodeTree]) -> None:
    bpy.data.batch_remove([*made, *(group for group in bpy.data.node_groups if group not in groups)])


def _take_name(
    datablock: bpy.types.ID,
    name: str,
    owner: bpy.types.bpy_prop_collection,
    made: Sequence[bpy.types.ID],
    names: ExitStack,
) -> None:
    """Give a temporary datablock the name of an existing one, which gets it back when `names` is closed."""
    other = owner.get((name, None))
    if other is not None and other not in made:
        other.name = "Imprint export"
        names.callback(setattr, other, "name", name)
    datablock.name = name


def _object(
    low: BakedLow,
    made: list[bpy.types.ID],
    names: ExitStack,
    known: dict[tuple, bpy.types.Material],
    *,
    with_tangents: bool,
) -> Staged:
    tiles, shift = _tiles(low)
    pairs, faces = np.unique(np.stack([low.slots, tiles], axis=1), axis=0, return_inverse=True)
    faces = faces.reshape(-1).astype(np.int32)
    order = np.argsort(faces, kind="stable")
    textures = [(int(slot), int(tile)) for slot, tile in pairs]
    mesh = bpy.data.meshes.new("Imprint export")
    made.append(mesh)
    uvs = {name: uv[order] for name, uv in low.uvs.items()}
    uvs[next(iter(uvs))] = low.uv[order] - shift[order][:, None]
    _fill(mesh, low, order, uvs, faces[order], with_tangents=with_tangents)
    obj = bpy.data.objects.new("Imprint export", mesh)
    made.append(obj)
    obj.matrix_world = Matrix(low.matrix)
    _take_name(obj, low.name, bpy.data.objects, made, names)
    _take_name(mesh, low.low.data.name, bpy.data.meshes, made, names)
    for texture in textures:
        mesh.materials.append(_material(low, texture, made, names, known))
    notes = list(low.deformation.notes)
    return Staged(low, obj, obj.name, next(iter(uvs.values())), textures, faces[order], order, notes)


def _deform(
    one: Staged,
    collection: bpy.types.Collection,
    armatures: dict[bpy.types.Object, bpy.types.Object],
    made: list[bpy.types.ID],
    names: ExitStack,
) -> None:
    """Give a staged object its shape keys and weights, and a copy of its armature. armatures: the copies, for all objects."""
    obj, deformation = one.object, one.baked.deformation
    for number, shape in enumerate(deformation.shapes):
        if number == 0:
            obj.shape_key_add(name="Basis", from_mix=False)
        key = obj.shape_key_add(name=shape.name, from_mix=False)
        key.value = 0.0
        key.points.foreach_set("co", np.ascontiguousarray(shape.points, np.float32).reshape(-1))
    source = deformation.armature
    if source is None:
        return
    if source not in armatures:
        armatures[source] = _at_rest(source, made, names)
        collection.objects.link(armatures[source])
    groups = [obj.vertex_groups.new(name=name) for name in deformation.groups]
    values = zip(deformation.numbers.tolist(), deformation.vertices.tolist(), deformation.weights.tolist(), strict=True)
    for group, vertex, weight in values:
        groups[group].add((vertex,), weight, "REPLACE")
    obj.modifiers.new("Armature", "ARMATURE").object = armatures[source]
    obj.parent = armatures[source]
    obj.matrix_parent_inverse = source.matrix_world.inverted()


def _at_rest(source: bpy.types.Object, made: list[bpy.types.ID], names: ExitStack) -> bpy.types.Object:
    """A copy of an armature that nothing moves, with its name."""
    copy, data = source.copy(), source.data.copy()
    made += [copy, data]
    copy.data = data
    copy.animation_data_clear()
    data.animation_data_clear()
    for constraint in list(copy.constraints):
        copy.constraints.remove(constraint)
    copy.parent = None
    copy.matrix_world = source.matrix_world
    data.pose_position = "REST"
    _take_name(copy, source.name, bpy.data.objects, made, names)
    _take_name(data, source.data.name, bpy.data.armatures, made, names)
    return copy


def _tiles(low: BakedLow) -> tuple[np.ndarray, np.ndarray]:
    """The UDIM tile of each triangle (T,) int32, and where it begins (T, 2) float32.

    Raises BakeError for a triangle in several tiles.
    """
    count = len(low.slots)
    if not low.reports[0].settings["udim"]:
        return np.full(count, FIRST, np.int32), np.zeros((count, 2), np.float32)
    begin = np.floor(low.uv.mean(axis=1))
    inside = low.uv - begin[:, None]
    if inside.min() < -1e-4 or inside.max() > 1.0 + 1e-4:
        raise BakeError(
            f"A triangle of {low.name!r} lies in several UDIM tiles, which no file of an engine can have: cut its UVs at "
            "the border of the tiles."
        )
    return (udim.FIRST + begin[:, 0] + udim.COLUMNS * begin[:, 1]).astype(np.int32), begin.astype(np.float32)


def _fill(
    mesh: bpy.types.Mesh,
    low: BakedLow,
    order: np.ndarray,
    uvs: dict[str, np.ndarray],
    faces: np.ndarray,
    *,
    with_tangents: bool,
) -> None:
    """Make `mesh` the triangles of `low` in this order. uvs: of each layer. faces: the material of each triangle."""
    mesh_writer.fill(mesh, low.vertices, low.corners[order])
    mesh.polygons.foreach_set("material_index", faces)
    mesh.update(calc_edges=True)
    for name, uv in uvs.items():
        mesh.uv_layers.new(name=name).uv.foreach_set("vector", uv.reshape(-1))
    mesh.uv_layers.active_index = 0
    mesh.uv_layers[0].active_render = True
    normals = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    normals.data.foreach_set("vector", low.normals[order].reshape(-1))
    if with_tangents:
        tangents = low.tangents[order].reshape(-1, 4)
        turned = np.stack([tangents[:, 0], tangents[:, 2], -tangents[:, 1], tangents[:, 3]], axis=1)
        mesh.attributes.new(TANGENTS, "QUATERNION", "CORNER").data.foreach_set("value", turned.reshape(-1))
        for number, shape in enumerate(low.deformation.shapes):
            x, y, z = (shape.normals - low.normals)[order].reshape(-1, 3).T
            moved = mesh.attributes.new(f"{SHAPE_NORMALS}{number}", "FLOAT_VECTOR", "CORNER")
            moved.data.foreach_set("vector", np.stack([x, z, -y], axis=1).reshape(-1))


def _material(
    low: BakedLow,
    texture: tuple[int, int],
    made: list[bpy.types.ID],
    names: ExitStack,
    known: dict[tuple, bpy.types.Material],
) -> bpy.types.Material:
    """A temporary copy of a material, or a new one, with its name. A tile's number is added to the name.

    texture: as in Staged. known: the copies for other objects, which share them if they have the same maps.
    """
    slot, tile = texture
    source, report = low.materials[slot] if slot < len(low.materials) else None, low.report_of(slot)
    key = None
    if source is not None and report is not None:
        images = tuple(sorted(how["image"] for how in report.maps.values()))
        key = source, tile, report.image, images, report.uv_layer
    if key in known:
        return known[key]
    copy = bpy.data.materials.new(low.name) if source is None else source.copy()
    older_blender.switch_on_nodes(copy)
    made.append(copy)
    name = low.name_of(slot)
    if low.reports[0].settings["udim"]:
        name = f"{name}_{tile}"
    _take_name(copy, name, bpy.data.materials, made, names)
    if key is not None:
        known[key] = copy
    return copy


def _with_maps(
    one: Staged, pictures: PictureFiles, channels: Sequence[str] | None, done: set[bpy.types.Material]
) -> list[str]:
    """Show the maps of the bake in the materials of a staged object. Returns notes. Raises BakeError.

    done: the materials that show them already, to which those of the object are added.
    """
    notes = []
    for number, (slot, tile) in enumerate(one.textures):
        report, material = one.baked.report_of(slot), one.object.data.materials[number]
        if material in done:
            continue
        done.add(material)
        if report is None:
            notes.append(
                f"The material slot {slot + 1} of {one.baked.name!r} has no maps: bake its texture set as well."
            )
            continue
        settings = report.settings
        layer = report.uv_layer
        if settings["normal"]:
            stored = tuple(settings[name] for name in ("red", "green", "blue"))
            wanted = tuple(channels or stored)
            image = pictures.normal_map(_image(report), tile, stored, wanted, dither=settings["dither"])
            shown = older_blender.exported_channels(wanted)
            notes += materials.hook_up(
                one.object, image, space=report.space, uv_layer=layer, channels=shown, slots=[number]
            )
        images, warnings = materials.images_of_report(report.maps, report.space)
        notes += warnings
        if images:
            own = {}
            for name, one_map in images.items():
                image = pictures.other_map(one_map.image, tile, has_alpha=_has_alpha(report, one_map))
                own[name] = replace(one_map, image=image)
            notes += materials.connect_maps(one.object, own, uv_layer=layer, slots=[number])
    return notes


def _name_textures(one: Staged, pictures: PictureFiles) -> None:
    """Give the other textures in the materials of a staged object files with names of their own."""
    for material in one.object.data.materials:
        for node in material.node_tree.nodes:
            if node.bl_idname == "ShaderNodeTexImage" and node.image and any(out.is_linked for out in node.outputs):
                node.image = pictures.own_file(node.image)


def _has_alpha(report: Report, map_image: materials.MapImage) -> bool:
    """Whether a channel of the bake's packed image is its alpha."""
    return any(
        how["image"] == map_image.image.name and "map" in how.get("channels", {}).get("alpha", {})
        for how in report.maps.values()
    )


def _image(report: Report) -> bpy.types.Image:
    image = datablocks.get(report.image)
    if image is None:
        raise BakeError(f"The image {report.image!r} was undone, renamed or deleted: bake again.")
    return image
