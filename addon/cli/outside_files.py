# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that an open scene from an untrusted .blend names outside the folder that may be read."""

import os
from collections.abc import Sequence

import bpy

from .. import older_blender
from ..core.errors import BakeError, shorten_list
from ..scene import dependencies
from .bounds import is_below


def forbid_scripts() -> None:
    """Run no scripts of files, even if preferences say so."""
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False


def leave_out(folders: Sequence[str]) -> list[str]:
    """Empty the paths of images, sounds, fonts, caches and others that are not below `folders`, so that they are not read.

    Returns sentences. Raises BakeError for libraries there, and for nodes that import files.
    """
    _check_nodes()
    for library in bpy.data.libraries:
        if not _is_inside(dependencies.absolute(library.filepath, library), folders):
            raise BakeError(f"The library {library.filepath!r} {_not_in(folders)}")
    left: list[str] = []

    def visit(owner: bpy.types.ID, path: str, _about: object) -> str | None:
        if not path or _is_inside(dependencies.absolute(path, owner), folders):
            return None
        left.append(path)
        return ""

    older_blender.visit_file_paths(visit)
    if not left:
        return []
    paths = shorten_list(map(repr, dict.fromkeys(left)))
    return [f"Files outside {folders[0]!r} were not read: {paths}."]


def check_reference(name: str, path: str, folders: Sequence[str]) -> None:
    """Raise BakeError if the file `name` refers to one that is not below `folders`. path: of that one, from the first."""
    if not _is_inside(os.path.join(os.path.dirname(name), path), folders):
        raise BakeError(f"{name!r} refers to {path!r}, which {_not_in(folders)}")


def _not_in(folders: Sequence[str]) -> str:
    return f"is not in {folders[0]!r}, the only folder that --untrusted reads."


def _check_nodes() -> None:
    for tree in bpy.data.node_groups:
        node = next((node for node in tree.nodes if node.bl_idname.startswith(dependencies.IMPORT_NODES)), None)
        if node is not None:
            raise BakeError(
                f"The node {node.name!r} of {tree.name!r} imports a file, which --untrusted refuses: remove it."
            )


def _is_inside(path: str, folders: Sequence[str]) -> bool:
    return any(is_below(os.path.realpath(path), folder) for folder in folders)
