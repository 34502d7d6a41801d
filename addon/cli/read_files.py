# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that an open scene reads: for reports, records and clashes, and those outside the folders of untrusted files."""

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy

from .. import older_blender
from ..core.errors import BakeError, shorten_list
from ..core.file_structure import usd_layers
from ..jobs.job import Job
from ..output import datablocks
from ..scene import dependencies
from . import plans
from .bounds import is_below
from .clashes import InputFiles


def read_by(options: argparse.Namespace, jobs: Sequence[Job]) -> Iterator[tuple[str, str]]:
    """The files that the open scene's bake reads beside those of its options, and what they are. Some may not exist."""
    yield from used(options)
    for name in plans.scene_paths(options):
        title = f"what {os.path.basename(name)!r} refers to"
        yield from ((path, title) for path in InputFiles().references(name))
    lows, highs = [job.low for job in jobs], [high for job in jobs for high in job.highs]
    cages = [job.cage for job in jobs if job.cage]
    for each in dependencies.of([*lows, *highs, *cages], highs):
        # The materials of a low object that is its own high one show the maps that the bake replaces.
        if not (each.is_own_map and set(lows) & set(highs)):
            yield each.path, each.what


def not_followed(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """Why the bake may read files that `read_by` does not know, in clauses."""
    objects = [obj for job in jobs for obj in (job.low, *job.highs, job.cage) if obj]
    return [
        *filter(None, (usd_layers.named(name).unknown for name in plans.scene_paths(options))),
        *dependencies.not_followed(objects),
    ]


def used(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """The files that the open scene uses beside its own, and what they are: libraries, caches, layers of USD files, textures of
    imported meshes."""
    yield from (
        (path, what) for path, what in datablocks.sources() if path != bpy.data.filepath
    )  # it may be saved over
    # The images of a .blend may be maps of an earlier bake, which the next bake replaces.
    named = plans.scene_paths(options)
    for name in named:
        yield from ((path, f"what {os.path.basename(name)!r} refers to") for path in usd_layers.named(name).layers)
    if named and not any(Path(name).suffix.lower().startswith(".blend") for name in named):
        for image in bpy.data.images:
            if image.filepath and image.source in {"FILE", "TILED", "SEQUENCE"}:
                yield bpy.path.abspath(image.filepath), "a texture of the meshes"


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
