# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of the open files before a bake: images that are missing, and meshes that do not fit each other."""

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy
import numpy as np

from ..core import map_types, placement, udim
from ..core.declarations.choices import Modifiers
from ..core.errors import BakeError, shorten_list
from ..core.file_formats import BY_ENDING
from ..core.file_structure import usd_layers
from ..core.file_structure.whole_files import MISSING
from ..core.settings import MapSettings
from ..jobs.job import Job
from ..scene import complaints, dependencies, object_checks
from . import plans, textures
from .option_types import word_for

_IMAGES = {*BY_ENDING, ".jpg", ".jpeg", ".webp", ".hdr", ".bmp"}
MOST_NAMED = 8
"""Missing files that a message names."""


def check_pages(options: argparse.Namespace, settings: MapSettings, jobs: Sequence[Job]) -> list[str]:
    """Sentences about material libraries and images that are missing, if a map shows materials.

    Raises BakeError for them, for other files that objects are made from, and for images, that are missing or not whole, unless
    the options allow it.
    """
    objects = list(dict.fromkeys(obj for job in jobs for obj in (job.low, *job.highs, job.cage) if obj))
    lacks = complaints.of_files(objects, for_render=settings.modifiers == Modifiers.RENDER)
    if lacks and not options.allow_missing_pages:  # else the bake says so
        more = f" So are {len(lacks) - MOST_NAMED} more." if len(lacks) > MOST_NAMED else ""
        raise BakeError(f"{' '.join(lacks[:MOST_NAMED])}{more} --allow-missing-pages makes it a warning.")
    maps = _of_materials(settings)
    if not maps:
        return []
    highs = [high for job in jobs for high in job.highs if high.type == "MESH"]
    libraries = list(_libraries(options))
    if not any(Path(name).suffix.lower().startswith(".blend") for name in plans.scene_paths(options) or (".blend",)):
        libraries += map(repr, textures.missing_tiles(highs))
    if options.allow_missing_pages:  # the bake reports the images that each material lacks
        return [_not_found(libraries)] if libraries else []
    lacking = dependencies.lacking(each for each in dependencies.of((), highs) if each.is_surface)
    missing = [*libraries, *(repr(each.path) for each in lacking if each.problem == MISSING)]
    broken = [f"{each.path!r} {each.problem}" for each in lacking if each.problem != MISSING]
    without = f"leave {shorten_list(map(word_for, maps))} out of the maps, or add --allow-missing-pages."
    if missing:
        raise BakeError(f"{_not_found(missing)} Put them beside the mesh file, {without}")
    if broken:
        named = shorten_list(broken, MOST_NAMED)
        raise BakeError(
            f"{_files(broken)} of the high meshes' materials cannot be read: {named}. Restore them, {without}"
        )
    return []


def _not_found(missing: Sequence[str]) -> str:
    return f"{_files(missing)} of the high meshes' materials cannot be found: {shorten_list(missing, MOST_NAMED)}."


def _files(found: Sequence[str]) -> str:
    return "1 file" if len(found) == 1 else f"{len(found)} files"


def fit_hints(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """Sentences about low and high meshes from files whose units, axes or places differ."""
    if not (options.low_file or options.file):
        return []
    bpy.context.view_layer.update()
    found = []
    for job in jobs:
        highs = [_box(high) for high in job.highs if high != job.low and high.type == "MESH"]
        if highs:
            corners = np.concatenate(highs)
            hint = placement.hint(_box(job.low), np.array([corners.min(axis=0), corners.max(axis=0)]))
            if hint and "offsets" in hint and options.origin is None:
                hint += " --origin X,Y,Z moves files that are far away to where the low mesh is."
            if hint and "turned" in hint and options.high_file and not options.high_up:
                hint += " --high-up names the axis that points up in the high file."
            found.append(hint)
    return list(dict.fromkeys(filter(None, found)))


def rounded_coordinates(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """Sentences about meshes of files whose coordinates were rounded, far from the origin."""
    if not (options.low_file or options.file):
        return []
    found = []
    for obj in dict.fromkeys(obj for job in jobs for obj in (job.low, *job.highs) if obj.type == "MESH"):
        corners = np.array(obj.bound_box, np.float64)
        box = np.array([corners.min(axis=0), corners.max(axis=0)])
        text = placement.rounding(box, np.array(obj.matrix_world, np.float64)[:3, 3])
        found += [f"{obj.name!r} {text}"] if text else []
    return found


def check_own_high(low: bpy.types.Object, option: str) -> None:
    """Raise BakeError if the low object cannot be its own high one. option: what names another one."""
    if low.type == "MESH" and not object_checks.own_highs(low):
        raise BakeError(f"{option} is missing, and {low.name!r} has no modifiers that add detail: name a high one.")


def refused_scripts() -> list[str]:
    """A warning if Blender refused scripts of the open file, which may move a mesh."""
    if not bpy.app.autoexec_fail:
        return []
    return [f"Scripts of the file were not run, and what they drive stays as saved: {bpy.app.autoexec_fail_message}."]


def _of_materials(settings: MapSettings) -> list[str]:
    """The maps of these settings that show materials, also those that are only packed."""
    known = [map_types.BY_NAME[name] for name in settings.drawn_maps]
    return [each.name for each in known if each.socket]


def _libraries(options: argparse.Namespace) -> Iterator[str]:
    """The material libraries that .obj files name and that are missing, and the images that Blender drops from USD files."""
    for name in [*options.file, *options.high_file]:
        path = Path(name).absolute()
        if path.suffix.lower() == ".obj":
            yield from (repr(str(path.parent / library)) for library in textures.missing_libraries(path))
        images = [each for each in usd_layers.named(str(path)).assets if Path(each).suffix.lower() in _IMAGES]
        yield from (
            repr(each) for each in images if not (udim.files(each) if udim.is_tiled(each) else os.path.isfile(each))
        )


def _box(obj: bpy.types.Object) -> np.ndarray:
    """The box (2, 3) float64 around an object, in world space."""
    matrix = np.array(obj.matrix_world, np.float64)
    corners = np.array(obj.bound_box, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return np.array([corners.min(axis=0), corners.max(axis=0)])
