# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of the open files before a bake: images that are missing, meshes that do not fit each other, and memory."""

import argparse
import ctypes
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from ..core import map_types, udim
from ..core.declarations.choices import Method, Modifiers
from ..core.errors import BakeError, shorten_list
from ..core.file_formats import BY_ENDING
from ..core.file_structure import obj_files, usd_layers
from ..core.file_structure.whole_files import MISSING, NO_PIXELS
from ..core.map_types import BY_NAME
from ..core.preflight import Amounts, Need, memory_sentence, placement_hint, rounding_hint, texel_bytes
from ..core.settings import MapSettings, Settings
from ..jobs import pair_checks
from ..jobs.job import Job, band_texels, draws_in_software
from ..scene import complaints, dependencies, imported_images
from ..scene.textures import header_size
from . import plans
from .option_types import word_for

_IMAGES = {*BY_ENDING, ".jpg", ".jpeg", ".webp", ".hdr", ".bmp"}
MOST_NAMED = 8
"""Missing files that a message names."""


def check_textures(options: argparse.Namespace, map_settings: MapSettings, jobs: Sequence[Job]) -> list[str]:
    """Sentences about material libraries and images that are missing, if a map shows materials.

    Raises BakeError for them, for other files that objects are made from, and for images, that are missing or not whole, unless
    the options allow it.
    """
    objects = list(dict.fromkeys(obj for job in jobs for obj in (job.low, *job.highs, job.cage) if obj))
    lacks = complaints.of_files(objects, for_render=map_settings.modifiers == Modifiers.RENDER)
    if lacks and not options.allow_missing_files:  # else the bake says so
        more = f" So are {len(lacks) - MOST_NAMED} more." if len(lacks) > MOST_NAMED else ""
        raise BakeError(f"{' '.join(lacks[:MOST_NAMED])}{more} --allow-missing-files makes it a warning.")
    maps = _of_materials(map_settings)
    if not maps:
        return []
    highs = [high for job in jobs for high in job.highs if high.type == "MESH"]
    libraries = list(_libraries(options))
    if not any(Path(name).suffix.lower().startswith(".blend") for name in plans.scene_paths(options) or (".blend",)):
        libraries += map(repr, imported_images.missing_tiles(highs))
    if options.allow_missing_files:  # the bake reports the images that each material lacks
        return [_not_found(libraries)] if libraries else []
    lacking = dependencies.lacking(each for each in dependencies.of((), highs) if each.is_surface)
    missing = [*libraries, *(repr(each.path) for each in lacking if each.problem == MISSING)]
    broken = [
        repr(each.path) if each.problem == NO_PIXELS else f"{each.path!r} {each.problem}"
        for each in lacking
        if each.problem != MISSING
    ]
    broken += [f"the packed image {name!r}" for name in dependencies.packed_without_pixels(highs)]
    without = f"leave {shorten_list(map(word_for, maps))} out of the maps, or add --allow-missing-files."
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


def _files(clauses: Sequence[str]) -> str:
    return "1 file" if len(clauses) == 1 else f"{len(clauses)} files"


def fit_hints(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """Sentences about low and high meshes from files whose units, axes or places differ."""
    if not (options.low_file or options.file):
        return []
    bpy.context.view_layer.update()
    hints = []
    for job in jobs:
        highs = [_box(high) for high in job.highs if high != job.low and high.type == "MESH"]
        if highs:
            corners = np.concatenate(highs)
            hint = placement_hint(_box(job.low), np.array([corners.min(axis=0), corners.max(axis=0)]))
            if hint and "offsets" in hint and options.origin is None:
                hint += " --origin X,Y,Z moves files that are far away to where the low mesh is."
            if hint and "turned" in hint and options.high_file and not options.high_up:
                hint += " --high-up names the axis that points up in the high file."
            hints.append(hint)
    return list(dict.fromkeys(filter(None, hints)))


def rounded_coordinates(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """Sentences about meshes of files whose coordinates were rounded, far from the origin."""
    if not (options.low_file or options.file):
        return []
    sentences = []
    for obj in dict.fromkeys(obj for job in jobs for obj in (job.low, *job.highs) if obj.type == "MESH"):
        corners = np.array(obj.bound_box, np.float64)
        box = np.array([corners.min(axis=0), corners.max(axis=0)])
        text = rounding_hint(box, np.array(obj.matrix_world, np.float64)[:3, 3])
        sentences += [f"{obj.name!r} {text}"] if text else []
    return sentences


def refused_scripts() -> list[str]:
    """A warning if Blender refused scripts of the open file, which may move a mesh."""
    if not bpy.app.autoexec_fail:
        return []
    return [f"Scripts of the file were not run, and what they drive stays as saved: {bpy.app.autoexec_fail_message}."]


def _of_materials(map_settings: MapSettings) -> list[str]:
    """The maps of these settings that show materials, also those that are only packed."""
    known = [map_types.BY_NAME[name] for name in map_settings.drawn_maps]
    return [each.name for each in known if each.socket]


def _libraries(options: argparse.Namespace) -> Iterator[str]:
    """The material libraries that .obj files name and that are missing, and the images that Blender drops from USD files."""
    for name in [*options.file, *options.high_file]:
        path = Path(name).absolute()
        if path.suffix.lower() == ".obj":
            yield from (repr(str(path.parent / library)) for library in obj_files.missing_libraries(path))
        named = usd_layers.named(str(path)).assets
        images = [each for each in named if Path(each.rstrip("]")).suffix.lower() in _IMAGES]
        yield from (
            repr(each) for each in images if not (udim.files(each) if udim.is_tiled(each) else os.path.isfile(each))
        )


def _box(obj: bpy.types.Object) -> np.ndarray:
    """The box (2, 3) float64 around an object, in world space."""
    matrix = np.array(obj.matrix_world, np.float64)
    corners = np.array(obj.bound_box, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return np.array([corners.min(axis=0), corners.max(axis=0)])


WORTH_A_LINE = 0.5
"""The share of the free memory from which the need is also printed where no terminal shows it."""


def check_memory(jobs: Sequence[Job], settings: Settings) -> tuple[str, bool, dict[str, int]]:
    """The memory for the largest of several jobs, whose GPU is started: a sentence, whether it needs attention, and bytes for
    the report. Empty where modifiers or instances decide how large the meshes are.
    """
    needs = [need for need in (need_of(job, settings) for job in jobs) if need]
    if len(needs) < len(jobs):
        return "", False, {}
    largest = max(needs, key=lambda need: need.peak)
    try:
        is_software, free = draws_in_software(), free_bytes()
    except (SystemError, RuntimeError):  # there is no GPU, as the bake will report
        return "", False, {}
    wanted = largest.of_machine(is_software=is_software)
    numbers = {"needed": wanted, "on_gpu": largest.on_gpu, "free": free or 0}
    return (
        memory_sentence(largest, free, is_software=is_software),
        free is not None and wanted > WORTH_A_LINE * free,
        numbers,
    )


def need_of(job: Job, settings: Settings) -> Need | None:
    """The memory that the bake of a job needs; None where modifiers or instances decide how many triangles there are."""
    objects = list(dict.fromkeys([job.low, *job.highs]))
    if any(obj.type != "MESH" or obj.modifiers or obj.is_instancer for obj in objects):
        return None
    shows_images = any(BY_NAME[name].family.shows_materials for name in settings.map.drawn_maps)
    textures = imported_images.images_of(job.highs)
    method, is_exact = settings.tracing.method, pair_checks.evaluates_materials(job.low, job.highs, settings.map)
    has_detail = bool(settings.map.detail_maps and (textures or is_exact)) or settings.map.edge_radius > 0.0
    on_gpu = texel_bytes(settings, method, has_detail=has_detail)
    return Need.of(
        Amounts(
            triangles=sum(len(obj.data.loops) - 2 * len(obj.data.polygons) for obj in objects),
            texels=settings.sampling.width * settings.sampling.height * max(1, len(settings.sampling.tiles)),
            band_texels=band_texels(settings.sampling, on_gpu),
            texel_bytes=on_gpu,
            other_maps=len(settings.map.drawn_maps),
            is_flat=method == Method.FLATTEN and not settings.map.drawn_maps and not has_detail,
            texture_pixels=max(map(_pixels, textures), default=0) if shows_images else 0,
            is_exact=is_exact,
        )
    )


def _pixels(image: bpy.types.Image) -> int:
    """The number of pixels of an image, or of its largest tile, by the headers of files; 0 for headers that are not known."""
    tiles = [tile.number for tile in image.tiles] if image.source == "TILED" else [0]
    sizes = (header_size(image, tile) or (0, 0) for tile in tiles)
    return max((width * height for width, height in sizes), default=0)


def free_bytes() -> int | None:
    """The memory that this process can have, with what it already has; None where the system does not say."""
    with suppress(OSError, ValueError, IndexError, AttributeError):
        if os.name == "nt":
            return _free_on_windows()
        fields = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines())
        page = os.sysconf("SC_PAGE_SIZE")
        own = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * page
        free = int(fields["MemAvailable"].split()[0]) * 1024 + own
        return min(free, _limit_of_container() or free)
    with suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")  # macOS reports only all memory
    return None


def _limit_of_container() -> int | None:
    """The bytes that a container on Linux may have, or None."""
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):  # "max" is no number
            return int(Path(name).read_text(encoding="ascii"))
    return None


class _Status(ctypes.Structure):
    """MEMORYSTATUSEX of Windows."""

    _fields_ = (
        ("length", ctypes.c_uint32),
        ("load", ctypes.c_uint32),
        *((name, ctypes.c_uint64) for name in ("total", "free", "total_file", "free_file", "total_virtual")),
        *((name, ctypes.c_uint64) for name in ("free_virtual", "free_extended")),
    )


def _free_on_windows() -> int | None:
    status = _Status(length=ctypes.sizeof(_Status))
    return status.free if ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)) else None
