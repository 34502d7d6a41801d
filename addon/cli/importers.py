# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports mesh files with Blender's importers, and completes and reports what these leave out."""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

import bpy
import numpy as np

from ..core.errors import BakeError
from ..output.files.atomic_file import reason
from . import blender_process, far_coordinates, ply, standard_streams, textures
from .textures import Materials

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
        raise BakeError(f"{str(path)!r} could not be imported: {_cause(error)}.") from error
    return [obj for obj in bpy.data.objects if obj.type == "MESH" and obj not in before]


def _import(path: Path, space: Space) -> None:
    far = far_coordinates.far_origin(path)
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
    textures.replace_placeholders(new_images, materials.placeholders, path.parent)
    textures.find_missing_files(new_images, path.parent)
    meshes = [obj for obj in new if obj.type == "MESH"]
    textures.tile_numbered_images(meshes)
    texture = ply.read_texture(path) if path.suffix.lower() == ".ply" else None
    for obj in meshes if texture else ():
        textures.show_texture(obj, texture, path.parent)
    textures.show_vertex_colors(meshes)


@contextmanager
def _staged(path: Path, subtracted: np.ndarray | None) -> Iterator[tuple[Path, Materials]]:
    """The file to import instead of `path`, and the materials whose images it stands in for.

    An .obj is imported from a folder with one library of all materials, whose images do not exist: the importer would load
    all of them at once, and find none whose names are from another machine.
    """
    materials = textures.read_materials(path) if path.suffix.lower() == ".obj" else Materials()
    if subtracted is None and not materials.content:
        yield path, materials
        return
    with tempfile.TemporaryDirectory(prefix="imprint-") as folder:
        staged = Path(folder) / path.name
        if subtracted is not None:
            far_coordinates.write_near(path, staged, subtracted)
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


def _cause(error: RuntimeError | OSError) -> str:
    """The importer's own message. Importers written in Python may fail with an error of Python, after a traceback."""
    if "Traceback" not in str(error):
        return reason(error)
    last = [line for line in str(error).splitlines() if line.strip() and not line.startswith((" ", "Location"))][-1]
    return f"it is damaged, or has something that Blender's importer does not expect ({last.rstrip('.')})"
