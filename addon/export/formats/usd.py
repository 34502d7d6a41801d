# SPDX-License-Identifier: GPL-3.0-or-later
"""USD: Blender's exporter writes it, with the maps in a folder beside it. It has no tangents: engines make them."""

from pathlib import Path

import bpy

from ...core.errors import BakeError
from ..baked_low import FileMesh
from ..staging import Stage, Staged
from . import imported

CHANNELS = ("+X", "+Y", "+Z")
"""The axes that normal maps store."""
HAS_TANGENTS = LINKS_LEVELS = False
NAMES_FILES = SHARES_FOLDER = True
"""Textures lie in a folder that other files have, too: their names begin with that of the file."""


def check() -> None:
    """Raise BakeError if the exporter is missing."""
    if "usd_export" not in dir(bpy.ops.wm):
        raise BakeError("This Blender was built without USD: choose another format.")


def write(stage: Stage, path: Path, *, are_levels: bool) -> list[Path]:
    """Write the staged objects to `path`. Returns the files."""
    assert not are_levels
    bpy.ops.wm.usd_export(
        filepath=str(path),
        check_existing=False,
        collection=stage.collection.name,
        export_animation=False,
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


def read(path: Path, one: Staged) -> FileMesh:
    """Read an object back. Raises BakeError."""
    return imported.read(
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
