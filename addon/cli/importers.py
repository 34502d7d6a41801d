# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports mesh files with Blender's importers, and completes and reports what these leave out: images, vertex colors, tiles."""

import math
import mmap
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile

import bpy
import numpy as np

from .. import older_blender
from ..core import udim
from ..core.errors import BakeError
from ..core.file_formats import OPEN_EXR
from ..core.file_structure import mesh_references
from ..output.atomic_file import reason
from ..scene import new_datablocks
from ..scene.textures import location
from . import blender_process, scan_files, standard_streams
from .scan_files import Texture

_COLORS = ("map_kd", "map_ke", "map_ks", "map_ka")
"""The lines whose images are colors. Others are numbers or normals, which are not stored as sRGB."""


@dataclass(frozen=True)
class NamedImage:
    """An image that materials name. name: as they spell it. path: its file, which may contain <UDIM>; None if it is missing.
    is_color: whether it stores colors, rather than numbers."""

    name: str
    path: Path | None
    is_color: bool


@dataclass(frozen=True)
class Materials:
    """The materials of an .obj.

    content: of one library with all of them, in which `placeholders` stand for the images.
    """

    content: bytes = b""
    placeholders: dict[str, NamedImage] = field(default_factory=dict)


def read_materials(path: Path) -> Materials:
    """The materials of the .obj at `path`. Raises OSError."""
    lines, known = [], {}
    for file in _libraries(path)[0]:
        folders = list(dict.fromkeys((file.parent, *mesh_references.folders(path))))
        for line in mesh_references.lines_of(file):
            lines.append(_with_placeholder(line, folders, known))
    placeholders = dict(known.values())
    return Materials(b"\n".join([*lines, b""]) if lines else b"", placeholders)


def missing_libraries(path: Path) -> list[str]:
    """The names of the libraries that the .obj at `path` needs and that do not exist. Raises OSError."""
    return _libraries(path)[1]


def _libraries(path: Path) -> tuple[list[Path], list[str]]:
    """The libraries of an .obj, and the names of those that do not exist."""
    folders = mesh_references.folders(path)
    found, missing = [], []
    for name in mesh_references.libraries(path):
        file = mesh_references.find_file(name, folders)
        if file is None and " " in name:  # several names in one line
            several = [mesh_references.find_file(each, folders) for each in name.split()]
            if all(several):
                found += several
                continue
        if file is not None:
            found.append(file)
        else:
            missing.append(name)
    # As in Blender's importer, one with the name of the .obj counts even if no line names it.
    own = mesh_references.find_file(f"{path.stem}.mtl", folders)
    return list(dict.fromkeys([*found, *([own] if own else [])])), [] if own else missing


def _with_placeholder(line: bytes, folders: list[Path], known: dict[tuple, tuple[str, NamedImage]]) -> bytes:
    """A line of a library, with a placeholder for the image that it names. known: the placeholders by image."""
    image = mesh_references.image_line(line)
    if image is None:
        return line.strip()
    word, options, name, whole = image
    clean = mesh_references.cleaned
    if not clean(name).strip("./"):  # it names a folder
        return b""
    path = mesh_references.find_file(name, folders)
    if path is None and name != whole and (path := mesh_references.find_file(whole, folders)):
        options, name = "", whole
    use = NamedImage(name, path, word.lower() in _COLORS)
    key = (path or clean(name), use.is_color)
    if key not in known:
        known[key] = f"imprint-image-{len(known)}{Path(clean(name)).suffix}", use
    return " ".join(filter(None, (word, options, known[key][0]))).encode()


_LINEAR = {*OPEN_EXR.endings, ".hdr"}
"""Endings of images that store linear colors."""


def replace_placeholders(images: Iterable[bpy.types.Image], named: Mapping[str, NamedImage], folder: Path) -> None:
    """Give the images of an .obj their files. named: by the name of the file that each image has now. folder: of the .obj.

    No image is loaded. An image whose file is missing gets the path where it should be.
    """
    for image in images:
        found = named.get(os.path.basename(image.filepath))
        if found is None:
            continue
        path = found.path or mesh_references.expected_path(found.name, folder)
        image.filepath = str(path)
        image.name = path.name
        if not found.is_color:
            image.colorspace_settings.is_data = True
        elif path.suffix.lower() in _LINEAR:
            image.colorspace_settings.name = "Linear Rec.709"
        if udim.TOKEN in path.name:
            _make_tiled(image, path)


def find_missing_files(images: Iterable[bpy.types.Image], folder: Path) -> None:
    """Look in `folder`, of the mesh file, for the files of new images that are not where their paths say.

    The importers of some formats load images; their memory is freed.
    """
    for image in images:
        if image.source == "FILE" and not image.packed_file and image.filepath and _lacks_file(image):
            found = mesh_references.find_file(image.filepath, [folder])
            if found is not None:
                image.filepath = str(found)
        if image.has_data and not image.is_dirty and image.source in {"FILE", "TILED"}:
            image.buffers_free()


def tile_numbered_images(objects: Iterable[bpy.types.Object]) -> None:
    """Tile the images of materials whose UVs lie on several UDIM tiles, and whose files are numbered, as scan_1001.png."""
    for obj in objects:
        for number, slot in enumerate(obj.material_slots):
            for image in _images(slot.material):
                path = Path(bpy.path.abspath(image.filepath)) if image.source == "FILE" and image.filepath else None
                tiled = path and mesh_references.tiled_path(path)
                if tiled and len(mesh_references.existing_tiles(tiled)) > 1 and _is_on_several_tiles(obj.data, number):
                    image.filepath = str(tiled)
                    _make_tiled(image, tiled)


def images_of(objects: Iterable[bpy.types.Object]) -> list[bpy.types.Image]:
    """The images that materials of `objects` use, each once."""
    materials = dict.fromkeys(slot.material for obj in objects for slot in obj.material_slots)
    return list(dict.fromkeys(image for material in materials for image in _images(material)))


def _missing_files(image: bpy.types.Image) -> Iterator[str]:
    if image.packed_file or not image.filepath or image.source not in {"FILE", "TILED"}:
        return
    for tile in [tile.number for tile in image.tiles] if image.source == "TILED" else [0]:
        path = location(image, tile)
        if _is_missing(Path(path)):
            yield path


def _lacks_file(image: bpy.types.Image) -> bool:
    return any(True for _ in _missing_files(image))


def _is_missing(path: Path) -> bool:
    try:
        return not path.is_file() or path.stat().st_size == 0
    except OSError:
        return True


def _make_tiled(image: bpy.types.Image, path: Path) -> None:
    """Make `image` a tiled one, with all tiles that exist for `path`, which contains <UDIM>."""
    image.source = "TILED"
    numbers = mesh_references.existing_tiles(path)
    for number in numbers:
        if number not in {tile.number for tile in image.tiles}:
            image.tiles.new(tile_number=number)
    for tile in [tile for tile in image.tiles if numbers and tile.number not in numbers]:
        image.tiles.remove(tile)


def _images(material: bpy.types.Material | None) -> Iterator[bpy.types.Image]:
    """The images of the nodes of a material and its groups."""
    left, seen = [material.node_tree] if material and material.node_tree else [], set()
    while left:
        tree = left.pop()
        if tree in seen:
            continue
        seen.add(tree)
        for node in tree.nodes:
            if node.type == "GROUP" and node.node_tree:
                left.append(node.node_tree)
            elif node.type == "TEX_IMAGE" and node.image:
                yield node.image


def missing_tiles(objects: Iterable[bpy.types.Object]) -> list[str]:
    """The files of tiles on which faces have UVs, and which the tiled images of their materials do not have."""
    found = []
    for obj in objects:
        for number, slot in enumerate(obj.material_slots):
            tiled = [image for image in _images(slot.material) if image.source == "TILED" and image.filepath]
            used = (
                [udim.number(*place) for place in _tiles_of(obj.data, number) if _can_have_tile(*place)]
                if tiled
                else ()
            )
            for image in tiled:
                missing = sorted({*used} - {tile.number for tile in image.tiles})
                found += [udim.fill_all(bpy.path.abspath(image.filepath), tile) for tile in missing]
    return list(dict.fromkeys(found))


def _can_have_tile(column: int, row: int) -> bool:
    return 0 <= column < udim.COLUMNS and 0 <= row < udim.ROWS


def _is_on_several_tiles(data: bpy.types.Mesh, material: int) -> bool:
    """Whether the faces of a material have UVs on more than one UDIM tile."""
    return len(_tiles_of(data, material)) > 1


def _tiles_of(data: bpy.types.Mesh, material: int) -> list[tuple[int, int]]:
    """The column and row of each UDIM tile on which the faces of a material have UVs."""
    layer = data.uv_layers.active
    if layer is None:
        return []
    uv = np.empty((len(data.loops), 2), np.float32)
    layer.uv.foreach_get("vector", uv.reshape(-1))
    sizes, materials = np.empty(len(data.polygons), np.int32), np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("loop_total", sizes)
    data.polygons.foreach_get("material_index", materials)
    own = uv[np.repeat(materials == material, sizes)]
    # Exactly on the border, a corner belongs to both tiles.
    tiles = np.unique(np.floor(own[(own % 1.0 != 0.0).all(axis=1)]), axis=0)
    return [(int(column), int(row)) for column, row in tiles if np.isfinite(column + row)]


UV_LAYER = "UVMap"


def show_texture(obj: bpy.types.Object, texture: Texture, folder: Path) -> None:
    """Show the images of a .ply on its mesh, with its UVs. Does nothing for a mesh without UVs. folder: of the file."""
    data = obj.data
    is_same = texture.corners is not None and _has_corners(data, texture.corners)
    if is_same:
        layer = data.uv_layers.new(name=UV_LAYER)
        layer.uv.foreach_set("vector", texture.uv.ravel())
    if not data.uv_layers:
        return
    for name in texture.names:
        path = mesh_references.find_file(name, [folder]) or mesh_references.expected_path(name, folder)
        # An image that is made, not loaded, may be missing.
        image = bpy.data.images.new(path.name, 1, 1)
        image.source, image.filepath = "FILE", str(path)
        data.materials.append(_material(path.stem, "ShaderNodeTexImage", image=image))
    if is_same:
        numbers = np.clip(texture.images, 0, len(texture.names) - 1).astype(np.int32)
        data.polygons.foreach_set("material_index", numbers)


def show_vertex_colors(objects: Iterable[bpy.types.Object]) -> None:
    """Show the active color attribute of each object that has one and no material."""
    for obj in objects:
        active = obj.data.color_attributes.active_color
        if active is not None and not any(slot.material for slot in obj.material_slots):
            obj.data.materials.append(_material(active.name, "ShaderNodeVertexColor", layer_name=active.name))


def _has_corners(data: bpy.types.Mesh, corners: np.ndarray) -> bool:
    """Whether the faces of a mesh are these triangles (T, 3) of points, in this order: the importer may leave some out."""
    if len(data.loops) != corners.size or len(data.polygons) != len(corners):
        return False
    found = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", found)
    return np.array_equal(found, corners.ravel())


def _material(name: str, node_type: str, **values) -> bpy.types.Material:
    """A material whose base color is the output of a node with these values."""
    material = bpy.data.materials.new(name)
    older_blender.switch_on_nodes(material)
    tree = material.node_tree
    node = tree.nodes.new(node_type)
    for key, value in values.items():
        setattr(node, key, value)
    surface = next(each for each in tree.nodes if each.type == "BSDF_PRINCIPLED")
    tree.links.new(node.outputs["Color"], surface.inputs["Base Color"])
    return material


_MOST = 1 << 22
"""Bytes of the importer's messages that are searched."""
_UNREAD = re.compile(rb"Could not (?:open asset|load sublayer) @(.+?)@ (?:for|of) ")
_LEFT_OUT = re.compile(rb"Invalid (?:vertex|UV|normal) index .*ignoring face")


class UnreadReference(BakeError):
    """A USD file refers to a file that cannot be read. path: of that file."""

    def __init__(self, name: str, path: str):
        super().__init__(f"{name!r} refers to {path!r}, which cannot be read.")
        self.path = path


@contextmanager
def check_messages(path: Path) -> Iterator[None]:
    """Raise UnreadReference or BakeError at the end of the block, which imports the file at `path`, if parts were left out."""
    with TemporaryFile() as file:
        with standard_streams.silence(into=file.fileno()):
            yield
        file.seek(0)
        printed = file.read(_MOST)
    if found := _UNREAD.search(printed):
        raise UnreadReference(str(path), found[1].decode(errors="backslashreplace"))
    if count := len(_LEFT_OUT.findall(printed)):
        faces = "1 face" if count == 1 else f"{count:,} faces"
        raise BakeError(
            f"{faces} of {str(path)!r} cannot be read, since points, UVs or normals are missing: export it again."
        )


IMPORTERS = {
    ".obj": ("wm", "obj_import", {}),
    ".ply": ("wm", "ply_import", {}),
    ".stl": ("wm", "stl_import", {}),
    ".gltf": ("import_scene", "gltf", {"disable_bone_shape": True}),  # it would be one more mesh
    ".glb": ("import_scene", "gltf", {"disable_bone_shape": True}),
    ".fbx": ("wm", "fbx_import", {}),
    ".usd": ("wm", "usd_import", {}),
    ".usda": ("wm", "usd_import", {}),
    ".usdc": ("wm", "usd_import", {}),
    ".usdz": ("wm", "usd_import", {}),
}
"""Blender's import operators by the ending of files, with further arguments. All of them turn Z up."""

WITHOUT_AXES = (".obj", ".ply", ".stl")
"""Endings of formats that do not say which axis is up."""
_FORWARD = {"Y": "NEGATIVE_Z", "Z": "Y"}
"""The axis that points forward, by the one that points up."""


@dataclass(frozen=True)
class Space:
    """What a mesh file does not say of its coordinates.

    origin: a point, in the axes of the file; a file far from the world's origin is moved so that this point gets there. up: the
    axis that points up, "Y" or "Z", in the formats of WITHOUT_AXES; empty for the one that Blender expects.
    """

    origin: tuple[float, float, float] | None = None
    up: str = ""


PLAIN = Space()
"""Coordinates as Blender reads them."""


def import_file(path: Path, space: Space) -> list[bpy.types.Object]:
    """Import a mesh file, or append the objects of a .blend. Returns the new meshes.

    Points far from the world's origin are not rounded: the object's location holds most of the distance. Raises BakeError.
    """
    before = set(bpy.data.objects)
    try:
        with standard_streams.silence():
            if path.suffix.lower() == ".blend":
                _append(path)
            else:
                _import(path, space)
    except AttributeError as error:
        raise BakeError(
            f"{str(path)!r} cannot be read: this Blender imports no {path.suffix.lower()} files."
        ) from error
    except (RuntimeError, OSError, ValueError) as error:  # ValueError: for a .blend that is open already
        raise BakeError(f"{str(path)!r} could not be imported: {_cause(error, path)}.") from error
    return [obj for obj in bpy.data.objects if obj.type == "MESH" and obj not in before]


@contextmanager
def scene_apart() -> Iterator[None]:
    """Import into a scene of its own, whose objects come into the open one at the end. What fails leaves nothing.

    Importers set frames, world, selection and mode of a scene, or switch to another one.
    """
    scene, window = bpy.context.scene, bpy.context.window
    layer = bpy.context.view_layer
    with ExitStack() as undo:
        undo.callback(new_datablocks.remove_new, new_datablocks.known())
        apart = bpy.data.scenes.new(
            " "
        )  # the first by name, in which the importer of glTF puts the variants of materials
        try:
            for name in ("scale_length", "system"):
                setattr(apart.unit_settings, name, getattr(scene.unit_settings, name))
            for name in ("fps", "fps_base"):
                setattr(apart.render, name, getattr(scene.render, name))
            with bpy.context.temp_override(scene=apart, view_layer=apart.view_layers[0]):
                yield
            for obj in apart.collection.objects:
                scene.collection.objects.link(obj)
            for collection in apart.collection.children:
                scene.collection.children.link(collection)
        finally:
            if window is not None and window.scene != scene:
                window.scene, window.view_layer = scene, layer
            bpy.data.scenes.remove(apart)
        undo.pop_all()


_SAYS_SHADING = re.compile(rb"^s[ \t]", re.MULTILINE)


def lacks_normals(path: Path, data: bpy.types.Mesh) -> bool:
    """Whether a mesh that was imported from `path` is flat only because the file does not say how it is shaded.

    glTF says that meshes without normals are flat, and an .obj can say it.
    """
    if path.suffix.lower() not in WITHOUT_AXES or data.normals_domain != "FACE" or "custom_normal" in data.attributes:
        return False
    if path.suffix.lower() != ".obj":
        return True
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return _SAYS_SHADING.search(text) is None


def smooth(data: bpy.types.Mesh, degrees: int) -> None:
    """Shade a mesh of `lacks_normals` smooth, with hard edges from an angle on; flat by 0."""
    if degrees:
        data.shade_smooth()
        data.set_sharp_from_angle(angle=math.radians(degrees))
    else:
        data.shade_flat()


def _import(path: Path, space: Space) -> None:
    far = scan_files.far_origin(path)
    subtracted = far if space.origin is None or far is None else np.array(space.origin, np.float64)
    objects, images = set(bpy.data.objects), set(bpy.data.images)
    with _staged(path, subtracted) as (staged, materials):
        module, operator, more = IMPORTERS[path.suffix.lower()]
        if space.up and path.suffix.lower() in WITHOUT_AXES:
            more = {**more, "up_axis": space.up, "forward_axis": _FORWARD[space.up]}
        if module == "import_scene":
            blender_process.complete()  # the importer is an add-on
        with check_messages(path):
            getattr(getattr(bpy.ops, module), operator)(filepath=str(staged), **more)
    new = [obj for obj in bpy.data.objects if obj not in objects]
    new_images = [image for image in bpy.data.images if image not in images]
    if subtracted is not None and space.origin is None:
        _move_back(new, subtracted)
    replace_placeholders(new_images, materials.placeholders, path.parent)
    find_missing_files(new_images, path.parent)
    meshes = [obj for obj in new if obj.type == "MESH"]
    tile_numbered_images(meshes)
    texture = scan_files.read_texture(path) if path.suffix.lower() == ".ply" else None
    for obj in meshes if texture else ():
        show_texture(obj, texture, path.parent)
    show_vertex_colors(meshes)


@contextmanager
def _staged(path: Path, subtracted: np.ndarray | None) -> Iterator[tuple[Path, Materials]]:
    """The file to import instead of `path`, and the materials whose images it stands in for.

    An .obj is imported from a folder with one library of all materials, whose images do not exist: the importer would load
    all of them at once, and find none whose names are from another machine.
    """
    materials = read_materials(path) if path.suffix.lower() == ".obj" else Materials()
    if subtracted is None and not materials.content:
        yield path, materials
        return
    with tempfile.TemporaryDirectory(prefix="imprint-") as folder:
        staged = Path(folder) / path.name
        if subtracted is not None:
            scan_files.write_near(path, staged, subtracted)
        else:
            _link(path, staged)
        if materials.content:
            staged.with_suffix(".mtl").write_bytes(materials.content)
        yield staged, materials


def _link(source: Path, target: Path) -> None:
    """Make `source` available at `target`, by a copy where links are not allowed."""
    try:
        os.symlink(source, target)
    except (OSError, NotImplementedError):
        shutil.copyfile(source, target)


def _move_back(objects: Sequence[bpy.types.Object], subtracted: np.ndarray) -> None:
    """Move new objects by `subtracted` (3,), which is in their own axes."""
    for obj in objects:
        if obj.parent is None:
            # Importers turn axes by 90 degrees, whose cosine is not exactly 0 in single precision.
            turn = np.round(np.array(obj.matrix_world, np.float64)[:3, :3])
            obj.location = np.array(obj.location) + turn @ subtracted
    bpy.context.view_layer.update()


def _append(path: Path) -> None:
    with bpy.data.libraries.load(str(path)) as (there, here):
        here.objects = there.objects
    for obj in filter(None, here.objects):
        bpy.context.scene.collection.objects.link(obj)


_NOT_READ = re.compile(r"Extension (\S+) is not available")


def _cause(error: RuntimeError | OSError, path: Path) -> str:
    """The importer's own message. Importers written in Python may fail with an error of Python, after a traceback."""
    packed = mesh_references.compressions(path)
    if packed and bpy.app.module:
        return (
            f"its meshes are compressed with {' and '.join(packed)}, which Blender's Python package lacks. Bake in an "
            "installed Blender, which has it, or save the file without compression"
        )
    if found := _NOT_READ.search(str(error)):
        return f"it needs {found[1]} of glTF, which Blender does not read. Save the file without it"
    if "Traceback" not in str(error):
        return reason(error)
    last = [line for line in str(error).splitlines() if line.strip() and not line.startswith((" ", "Location"))][-1]
    return f"it is damaged, or has something that Blender's importer does not expect ({last.rstrip('.')})"
