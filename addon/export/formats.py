# SPDX-License-Identifier: GPL-3.0-or-later
"""The formats of files for engines: Blender's exporter writes each one, and it is read back as an engine would read it.

Binary glTF (Khronos glTF 2.0 specification, section 4.4) gets the tangents of the bake and levels of detail afterwards, and is
read here. USD and FBX are read with Blender's importers, into a scene of their own that is removed afterwards: engines make
MikkTSpace tangents of the triangles in such a file, as Blender does.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import bpy
import numpy as np

from ..core import file_formats
from ..core.errors import BakeError
from ..output import atomic_file
from ..scene import mesh_reader
from .baked_low import FileMesh
from .binary_gltf import Glb
from .staging import SHAPE_NORMALS, TANGENTS, Stage, Staged


@dataclass(frozen=True)
class MeshFormat:
    """A format of meshes with maps.

    Attributes:
        check: Raises BakeError if Blender's exporter is missing.
        write: Writes the staged objects, as levels of detail from the finest if `are_levels`, and returns the files.
        read: Reads an object back, and raises BakeError.
        channels: The axes that normal maps store; None where the format does not say them, so that they stay as the bake has
            them.
        has_tangents: Whether it stores the tangents of the bake.
        links_levels: Whether it holds levels of detail.
        names_files: Whether textures of the same file name become one.
        has_webp: Whether textures may be WebP.
        shares_folder: Whether textures lie in a folder that other files have, too, so that their names begin with that of the
            file.
    """

    check: Callable[[], None]
    write: Callable[..., list[Path]]
    read: Callable[[Path, Staged], FileMesh]
    channels: tuple[str, str, str] | None = ("+X", "+Y", "+Z")
    has_tangents: bool = False
    links_levels: bool = False
    names_files: bool = False
    has_webp: bool = False
    shares_folder: bool = False


LEVELS = "MSFT_lod"
"""The extension whose nodes name others as their coarser levels."""


def _check_glb() -> None:
    """Raise BakeError if the exporter is missing."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        raise BakeError("Blender's add-on glTF 2.0 is off: enable it in the preferences.")


def _write_glb(stage: Stage, path: Path, *, are_levels: bool) -> list[Path]:
    """Write the staged objects to `path`; as levels of detail, from the finest, if `are_levels`. Returns the files."""
    bpy.ops.export_scene.gltf(
        filepath=str(path),
        check_existing=False,
        export_format="GLB",
        collection=stage.collection.name,
        export_image_format="AUTO",
        export_texcoords=True,
        export_normals=True,
        export_tangents=False,  # they would be of the mesh in triangles, without the quads that the bake had
        export_attributes=True,
        export_materials="EXPORT",
        export_yup=True,
        export_apply=False,
        export_animations=False,
        export_current_frame=True,
        export_skins=True,
        export_def_bones=True,
        export_rest_position_armature=True,
        export_morph=True,
        export_morph_normal=False,  # those of keys that the file gets are of the bake's own mesh, with its custom normals
        export_extras=False,
        export_cameras=False,
        export_lights=False,
        export_vertex_color="NONE",
        export_draco_mesh_compression_enable=False,
        export_hierarchy_full_collections=False,
        use_mesh_edges=False,
        use_mesh_vertices=False,
        will_save_settings=False,
    )
    glb = Glb.parsed(path.read_bytes())
    for mesh in glb.tree.get("meshes", ()):
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            attributes["TANGENT"] = attributes.pop(TANGENTS)
            for number, target in enumerate(primitive.get("targets", ())):
                target["NORMAL"] = attributes.pop(f"{SHAPE_NORMALS}{number}")
    if are_levels:
        _link_levels(glb.tree, [one.name for one in stage.objects])
    path.write_bytes(glb.packed())
    return [path]


def _link_levels(tree: dict[str, Any], names: Sequence[str]) -> None:
    """Make the nodes after the first its coarser levels: the scene shows only the first."""
    first, *others = (_node(tree, name) for name in names)
    tree["nodes"][first].setdefault("extensions", {})[LEVELS] = {"ids": others}
    tree.setdefault("extensionsUsed", []).append(LEVELS)
    for owner, key in [
        *((scene, "nodes") for scene in tree["scenes"]),
        *((node, "children") for node in tree["nodes"]),
    ]:
        if key in owner:
            owner[key] = [number for number in owner[key] if number not in others]


def _node(tree: dict[str, Any], name: str) -> int:
    numbers = [number for number, node in enumerate(tree["nodes"]) if node.get("name") == name and "mesh" in node]
    if not numbers:
        raise BakeError(f"Blender's exporter left out {name!r}.")
    return numbers[0]


def _read_glb(path: Path, one: Staged) -> FileMesh:
    """Read an object back. Raises BakeError."""
    glb = Glb.parsed(path.read_bytes())
    tree = glb.tree
    mesh = tree["meshes"][tree["nodes"][_node(tree, one.name)]["mesh"]]
    parts: dict[str, list[np.ndarray]] = {}
    pictures: list[bytes | None] = []
    for number, primitive in enumerate(mesh["primitives"]):
        indices = glb.accessor(primitive["indices"])[:, 0].reshape(-1, 3)
        texture = tree["materials"][primitive["material"]].get("normalTexture") if "material" in primitive else None
        pictures.append(glb.image(texture["index"]) if texture else None)
        layer = f"TEXCOORD_{texture.get('texCoord', 0) if texture else 0}"
        for name, accessor in primitive["attributes"].items():
            key = "uv" if name == layer else name.lower()
            parts.setdefault(key, []).append(glb.accessor(accessor)[indices])
        parts.setdefault("material", []).append(np.full(len(indices), number))
    arrays = {name: np.concatenate(values) for name, values in parts.items()}
    uv = arrays["uv"].copy()
    uv[..., 1] = 1.0 - uv[..., 1]
    has_tangents = len(arrays.get("tangent", ())) == len(arrays["position"])
    return FileMesh(
        _z_up(arrays["position"]),
        _z_up(arrays["normal"]),
        uv,
        _z_up(arrays["tangent"]) if has_tangents else None,
        arrays["material"],
        pictures,
    )


def _z_up(values: np.ndarray) -> np.ndarray:
    """Vectors (..., n) of glTF, where Y is up, in Blender's axes. A fourth component stays."""
    return np.concatenate([values[..., :1], -values[..., 2:3], values[..., 1:2], values[..., 3:]], axis=-1)


_COLLECTIONS = (
    "scenes",
    "collections",
    "objects",
    "meshes",
    "materials",
    "images",
    "armatures",
    "actions",
    "node_groups",
)
"""The kinds of datablocks that importers make."""


def _imported(path: Path, one: Staged, importer: Callable[[], object]) -> FileMesh:
    """Read an object back. importer: imports the file. Raises BakeError."""
    with _objects(path, importer) as objects:
        return _file_mesh(_found(objects, one.name), one)


@contextmanager
def _objects(path: Path, importer: Callable[[], object]) -> Iterator[list[bpy.types.Object]]:
    before = {name: set(getattr(bpy.data, name)) for name in _COLLECTIONS}
    try:
        scene = bpy.data.scenes.new("Imprint export")
        try:
            with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
                importer()
        except (RuntimeError, OSError) as error:
            raise BakeError(f"{path.name!r} could not be read back: {atomic_file.reason(error)}.") from error
        yield [obj for obj in bpy.data.objects if obj not in before["objects"] and obj.type == "MESH"]
    finally:
        new = [block for name in _COLLECTIONS for block in getattr(bpy.data, name) if block not in before[name]]
        bpy.data.batch_remove(new)


def _found(objects: list[bpy.types.Object], name: str) -> bpy.types.Object:
    """The object that was written with this name: formats replace signs in names, and Blender adds numbers."""
    plain = re.sub(r"\W", "_", name)
    candidates = [obj for obj in objects if re.sub(r"\W", "_", re.sub(r"\.\d{3,}$", "", obj.name)) == plain]
    if not candidates and len(objects) == 1:
        candidates = objects
    if len(candidates) != 1:
        raise BakeError(f"Blender's exporter left out {name!r}, or changed its name.")
    return candidates[0]


def _file_mesh(obj: bpy.types.Object, one: Staged) -> FileMesh:
    data = obj.data
    if not data.uv_layers:
        raise BakeError(f"The file has no UVs of {one.name!r}: it was not written.")
    mesh = mesh_reader.with_tangents(data, data.uv_layers[0].name, obj.name, mesh_reader.matrix(obj))
    slots = mesh.labels[:, 0].astype(np.int32)
    textures = np.full(max(len(obj.material_slots), int(slots.max()) + 1), -1)
    if len(slots) == len(one.faces):  # formats order materials as they like
        textures[slots] = one.faces
    pictures: list[bytes | None] = [None] * len(one.textures)
    for slot in obj.material_slots:
        texture = textures[slot.slot_index]
        if texture >= 0 and slot.material is not None:
            pictures[texture] = _normal_map(slot.material)
    return FileMesh(
        mesh.positions[mesh.vertices][mesh.triangles],
        mesh.normals[mesh.triangles],
        mesh.uv[mesh.triangles],
        mesh.tangents[mesh.triangles],
        textures[slots],
        pictures,
        has_tangents=False,
    )


def _normal_map(material: bpy.types.Material) -> bytes | None:
    """The file of the image that a Normal Map node of a material shows, or None."""
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeNormalMap":
            image = _image_behind(node.inputs["Color"])
            if image is not None:
                packed = image.packed_file
                return packed.data if packed else Path(bpy.path.abspath(image.filepath)).read_bytes()
    return None


def _image_behind(socket: bpy.types.NodeSocket) -> bpy.types.Image | None:
    """The first image among the nodes that feed an input."""
    waiting = [link.from_node for link in socket.links]
    while waiting:
        node = waiting.pop()
        if node.bl_idname == "ShaderNodeTexImage":
            return node.image
        waiting += [link.from_node for other in node.inputs for link in other.links]
    return None


def _check_usd() -> None:
    """Raise BakeError if the exporter is missing."""
    if "usd_export" not in dir(bpy.ops.wm):
        raise BakeError("This Blender was built without USD: choose another format.")


def _write_usd(stage: Stage, path: Path, *, are_levels: bool) -> list[Path]:
    """Write the staged objects to `path`. Returns the files."""
    assert not are_levels
    bpy.ops.wm.usd_export(
        filepath=str(path),
        check_existing=False,
        collection=stage.collection.name,
        export_animation=False,
        export_armatures=True,
        only_deform_bones=True,
        export_shapekeys=True,
        export_uvmaps=True,
        rename_uvmaps=True,
        export_mesh_colors=False,
        export_normals=True,
        export_materials=True,
        generate_preview_surface=True,
        export_textures_mode="NEW",
        overwrite_textures=True,
        relative_paths=True,
        export_custom_properties=False,
        convert_world_material=False,
        triangulate_meshes=False,
        evaluation_mode="VIEWPORT",
    )
    return [path, *sorted((path.parent / "textures").glob("*"))]


def _read_usd(path: Path, one: Staged) -> FileMesh:
    """Read an object back. Raises BakeError."""
    return _imported(
        path,
        one,
        lambda: bpy.ops.wm.usd_import(
            filepath=str(path),
            import_textures_mode="IMPORT_NONE",
            mtl_name_collision_mode="MAKE_UNIQUE",
            set_frame_range=False,
            create_collection=False,
        ),
    )


def _check_fbx() -> None:
    """Raise BakeError if the exporter is missing."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_fbx"):
        raise BakeError("Blender's add-on FBX is off: enable it in the preferences.")


def _write_fbx(stage: Stage, path: Path, *, are_levels: bool) -> list[Path]:
    """Write the staged objects to `path`. Returns the files."""
    assert not are_levels
    bpy.ops.export_scene.fbx(
        filepath=str(path),
        check_existing=False,
        collection=stage.collection.name,
        object_types={"MESH", "ARMATURE"},
        use_armature_deform_only=True,
        add_leaf_bones=False,
        use_mesh_modifiers=False,
        mesh_smooth_type="OFF",  # the normals say it all
        colors_type="NONE",
        use_tspace=True,
        use_triangles=False,
        use_custom_props=False,
        bake_anim=False,
        path_mode="COPY",
        embed_textures=True,
    )
    return [path]


def _read_fbx(path: Path, one: Staged) -> FileMesh:
    """Read an object back. Raises BakeError."""
    return _imported(path, one, lambda: bpy.ops.wm.fbx_import(filepath=str(path), use_anim=False))


_GLB = MeshFormat(_check_glb, _write_glb, _read_glb, has_tangents=True, links_levels=True, has_webp=True)
_USD = MeshFormat(_check_usd, _write_usd, _read_usd, names_files=True, shares_folder=True)
_FBX = MeshFormat(_check_fbx, _write_fbx, _read_fbx, channels=None, names_files=True)
FORMATS: Mapping[str, MeshFormat] = MappingProxyType(
    dict(zip(file_formats.MESHES, (_GLB, _USD, _USD, _USD, _FBX), strict=True))
)
"""By the ending of the file."""
