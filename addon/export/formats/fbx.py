# SPDX-License-Identifier: GPL-3.0-or-later
"""FBX: Blender's exporter writes it, with the maps inside, as the bake stored their channels."""

from pathlib import Path

import bpy

from ...core.errors import BakeError
from ..baked_low import FileMesh
from ..staging import Stage, Staged
from . import imported

CHANNELS = None
"""The format does not say which axes normal maps store: they stay as the bake has them."""
HAS_TANGENTS = LINKS_LEVELS = SHARES_FOLDER = False
NAMES_FILES = True
"""Textures of the same file name become one."""


def check() -> None:
    """Raise BakeError if the exporter is missing."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_fbx"):
        raise BakeError("Blender's add-on FBX is off: enable it in the preferences.")


def write(stage: Stage, path: Path, *, are_levels: bool) -> list[Path]:
    """Write the staged objects to `path`. Returns the files."""
    assert not are_levels
    bpy.ops.export_scene.fbx(
        filepath=str(path),
        check_existing=False,
        collection=stage.collection.name,
        object_types={"MESH"},
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


def read(path: Path, one: Staged) -> FileMesh:
    """Read an object back. Raises BakeError."""
    return imported.read(path, one, lambda: bpy.ops.wm.fbx_import(filepath=str(path), use_anim=False))
