# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes what a bake leaves beside its maps: the scene, and the low meshes in a file for an engine."""

from collections.abc import Callable, Sequence
from pathlib import Path

import bpy

from ..core import naming
from ..core.report import Report
from ..output.atomic_file import replacing
from . import blender_process, standard_streams

EXPORTERS = {".fbx": ("io_scene_fbx",)}
"""Blender's add-ons that write files, by their ending, beside those that `blender_process.complete` loads."""


def export(
    reports: Sequence[Report], output: str, check_beside: Callable[[str], None], *, are_levels: bool = False
) -> list[Report]:
    """Write the low meshes of `reports` with their maps to `output`, with a file for each if it has LOW.

    check_beside: as in engine_files.export. are_levels: whether those in one file are levels of detail of one object, from the
    finest. Returns the reports with what the files show. Raises BakeError.
    """
    from ..export import engine_files  # here, since a bake without exports does not need it

    blender_process.complete(*EXPORTERS.get(Path(output).suffix.lower(), ()))
    by_low: dict[int, list[Report]] = {}
    for report in reports:
        by_low.setdefault(report.refs[0].uid, []).append(report)
    lows = list(by_low.values())
    together = [[low] for low in lows] if naming.LOW in output else [lows]
    found = {}
    for bakes in together:
        path = Path(naming.fill(output, bakes[0][0].low)).absolute()
        with standard_streams.silence():
            are_linked = are_levels and len(bakes) > 1
            done = engine_files.export_files(bpy.context, bakes, path, are_levels=are_linked, check_beside=check_beside)
        found |= {bake[0].refs[0].uid: one for bake, one in zip(bakes, done, strict=True)}
    result = []
    for report in reports:
        one = found[report.refs[0].uid]
        result.append(report.with_export(one.to_dict()).with_warnings(one.warnings))
    return result


def _image_names(reports: Sequence[Report]) -> set[str]:
    """The names of the images that hold the maps. A sequence keeps only that of the normal map."""
    return {name for report in reports for name in (report.image, *(how["image"] for how in report.maps.values()))}


def save_scene(path: Path, reports: Sequence[Report]) -> None:
    """Save the scene; the paths of the maps of `reports` become relative."""
    maps = set(map(bpy.data.images.get, _image_names(reports))) - {None}
    folder = path.parent.resolve()  # it may have been named with ".."
    for image in maps:
        output = Path(bpy.path.abspath(image.filepath))
        if output.parent.resolve().is_relative_to(folder):
            # So that the files can be moved together. Relative to the file that is open: saving takes all such paths
            # along to the new place.
            image.filepath = bpy.path.relpath(str(output), start=str(Path(bpy.data.filepath or path).parent))
    with replacing(path) as partial, standard_streams.silence():
        # As a copy: relative paths are those of the final place, which is in the same folder.
        bpy.ops.wm.save_as_mainfile(filepath=str(partial), copy=True, compress=False, relative_remap=True)
