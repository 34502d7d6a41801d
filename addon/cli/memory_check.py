# SPDX-License-Identifier: GPL-3.0-or-later
"""Reports before a bake how much memory it needs, and how much is free."""

import ctypes
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import bpy

from ..core.declarations.choices import Method
from ..core.map_types import BY_NAME
from ..core.memory_need import Amounts, Need, sentence
from ..core.settings import Settings
from ..jobs.job import Job, band_texels, draws_in_software
from ..scene import image_files
from . import textures

WORTH_A_LINE = 0.5
"""The share of the free memory from which the need is also printed where no terminal shows it."""


def check(jobs: Sequence[Job], settings: Settings) -> tuple[str, bool, dict[str, int]]:
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
        sentence(largest, free, is_software=is_software),
        free is not None and wanted > WORTH_A_LINE * free,
        numbers,
    )


def need_of(job: Job, settings: Settings) -> Need | None:
    """The memory that the bake of a job needs; None where modifiers or instances decide how many triangles there are."""
    objects = list(dict.fromkeys([job.low, *job.highs]))
    if any(obj.type != "MESH" or obj.modifiers or obj.is_instancer for obj in objects):
        return None
    shows_images = any(BY_NAME[name].family.shows_materials for name in settings.map.drawn_maps)
    pages = textures.images_of(job.highs)
    return Need.of(
        Amounts(
            triangles=sum(len(obj.data.loops) - 2 * len(obj.data.polygons) for obj in objects),
            texels=settings.sampling.width * settings.sampling.height * max(1, len(settings.sampling.tiles)),
            band_texels=band_texels(settings.sampling),
            samples=settings.sampling.samples,
            other_maps=len(settings.map.drawn_maps),
            is_adaptive=settings.sampling.are_adaptive(settings.tracing.method) and not settings.map.drawn_maps,
            is_flat=settings.tracing.method == Method.FLATTEN
            and not settings.map.drawn_maps
            and not (settings.map.detail_maps and pages),
            page_pixels=max(map(_pixels, pages), default=0) if shows_images else 0,
        )
    )


def _pixels(image: bpy.types.Image) -> int:
    """The number of pixels of an image, or of its largest tile, by the headers of files; 0 for headers that are not known."""
    tiles = [tile.number for tile in image.tiles] if image.source == "TILED" else [0]
    sizes = (image_files.header_size(image, tile) or (0, 0) for tile in tiles)
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
