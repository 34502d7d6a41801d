# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports mesh files with Blender's importers, and completes and reports what these leave out."""

import math
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

import bpy
import numpy as np

from ..core import quiet
from ..core.errors import BakeError, reason
from ..core.file_formats import OPENED
from ..core.file_structure import far_points, gltf_files, obj_files, ply_files, whole_files
from . import addons, imported_images, new_datablocks

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
        with quiet.silence(into=file.fileno()):
            yield
        file.seek(0)
        printed = file.read(_MOST)
    if unread := _UNREAD.search(printed):
        raise UnreadReference(str(path), unread[1].decode(errors="backslashreplace"))
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

    Attributes:
        origin: A point, in the axes of the file; a file far from the world's origin is moved so that this point gets there.
        up: The axis that points up, "Y" or "Z", in the formats of WITHOUT_AXES; empty for the one that Blender expects.
    """

    origin: tuple[float, float, float] | None = None
    up: str = ""


PLAIN = Space()
"""Coordinates as Blender reads them."""


def import_meshes(name: str, space: Space) -> list[bpy.types.Object]:
    """Import a file, or append the objects of a .blend; returns the meshes that have faces. Raises BakeError."""
    path = existing(name)
    if path.suffix.lower() not in OPENED:
        raise BakeError(f"{str(path)!r} is not a supported mesh file. Supported: {', '.join(OPENED)}.")
    meshes = [obj for obj in import_file(path, space) if obj.data.polygons or obj.modifiers]
    if not meshes:
        raise BakeError(f"{str(path)!r} holds no mesh with faces.")
    return meshes


def existing(name: str) -> Path:
    """The absolute path of a file that is there and whole. Raises BakeError."""
    path = Path(name).absolute()
    if not os.path.isfile(path):
        raise BakeError(f"There is no file {str(path)!r}.")
    if problem := whole_files.problem(str(path)):
        raise BakeError(f"{str(path)!r} {problem}.")
    return path


def import_file(path: Path, space: Space) -> list[bpy.types.Object]:
    """Import a mesh file, or append the objects of a .blend. Returns the new meshes.

    Points far from the world's origin are not rounded: the object's location holds most of the distance. Raises BakeError.
    """
    before = set(bpy.data.objects)
    try:
        with quiet.silence():
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
            layer.update()  # else it lacks them
        finally:
            if window is not None and window.scene != scene:
                window.scene, window.view_layer = scene, layer
            bpy.data.scenes.remove(apart)
        undo.pop_all()


def lacks_normals(path: Path, data: bpy.types.Mesh) -> bool:
    """Whether a mesh that was imported from `path` is flat only because the file does not say how it is shaded.

    glTF says that meshes without normals are flat, and an .obj can say it.
    """
    if path.suffix.lower() not in WITHOUT_AXES or data.normals_domain != "FACE" or "custom_normal" in data.attributes:
        return False
    return path.suffix.lower() != ".obj" or not obj_files.says_shading(path)


def smooth(data: bpy.types.Mesh, degrees: int) -> None:
    """Shade a mesh of `lacks_normals` smooth, with hard edges from an angle on; flat by 0."""
    if degrees:
        data.shade_smooth()
        data.set_sharp_from_angle(angle=math.radians(degrees))
    else:
        data.shade_flat()


def _import(path: Path, space: Space) -> None:
    far = far_points.far_origin(path)
    subtracted = far if space.origin is None or far is None else np.array(space.origin, np.float64)
    objects, images = set(bpy.data.objects), set(bpy.data.images)
    with _staged(path, subtracted) as (staged, materials):
        module, operator, more = IMPORTERS[path.suffix.lower()]
        if space.up and path.suffix.lower() in WITHOUT_AXES:
            more = {**more, "up_axis": space.up, "forward_axis": _FORWARD[space.up]}
        if module == "import_scene":
            addons.load()  # the importer is an add-on
        with check_messages(path):
            getattr(getattr(bpy.ops, module), operator)(filepath=str(staged), **more)
    new = [obj for obj in bpy.data.objects if obj not in objects]
    new_images = [image for image in bpy.data.images if image not in images]
    if subtracted is not None and space.origin is None:
        _move_back(new, subtracted)
    imported_images.replace_placeholders(new_images, materials.placeholders, path.parent)
    imported_images.find_missing_files(new_images, path.parent)
    meshes = [obj for obj in new if obj.type == "MESH"]
    imported_images.tile_numbered_images(meshes)
    texture = ply_files.read_texture(path) if path.suffix.lower() == ".ply" else None
    for obj in meshes if texture else ():
        imported_images.show_texture(obj, texture, path.parent)
    imported_images.show_vertex_colors(meshes)


@contextmanager
def _staged(path: Path, subtracted: np.ndarray | None) -> Iterator[tuple[Path, obj_files.Materials]]:
    """The file to import instead of `path`, and the materials whose images it stands in for.

    An .obj is imported from a folder with one library of all materials, whose images do not exist: the importer would load
    all of them at once, and find none whose names are from another machine.
    """
    materials = obj_files.read_materials(path) if path.suffix.lower() == ".obj" else obj_files.Materials()
    if subtracted is None and not materials.content:
        yield path, materials
        return
    with tempfile.TemporaryDirectory(prefix="imprint-") as folder:
        staged = Path(folder) / path.name
        if subtracted is not None:
            far_points.write_near(path, staged, subtracted)
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
    packed = gltf_files.compressions(path)
    if packed and bpy.app.module:
        return (
            f"its meshes are compressed with {' and '.join(packed)}, which Blender's Python package lacks. Bake in an "
            "installed Blender, which has it, or save the file without compression"
        )
    if unknown := _NOT_READ.search(str(error)):
        return f"it needs {unknown[1]} of glTF, which Blender does not read. Save the file without it"
    if "Traceback" not in str(error):
        return reason(error)
    last = [line for line in str(error).splitlines() if line.strip() and not line.startswith((" ", "Location"))][-1]
    return f"it is damaged, or has something that Blender's importer does not expect ({last.rstrip('.')})"
