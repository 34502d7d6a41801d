# SPDX-License-Identifier: GPL-3.0-or-later
"""What bakes cost, so that a run can be divided into parts that take about the same time."""

import argparse
import functools

from ...core.settings import Settings
from . import named_files, run_clashes
from .input_files import InputFiles

BYTE = 2
"""What a byte of a file to read costs, where a sample of a texel costs 1."""


def cost(options: argparse.Namespace, files: InputFiles) -> int:
    """The cost of a bake, which has no unit and is the same on every machine. files: gives the sizes of its inputs."""
    maps = 1 if options.convert else max(1, _maps(options))
    samples = 1 if options.convert else options.samples
    texels = options.size[0] * options.size[1] * max(1, len(options.tiles)) * max(1, len(run_clashes.frames(options)))
    # A scene that is saved may replace the file that it was read from, while other machines look for their part.
    read = () if options.save_blend else {path for path, _ in named_files.inputs(options)}
    return texels * samples * maps + BYTE * sum(map(files.size, read))


def _maps(options: argparse.Namespace) -> int:
    """How many maps are drawn."""
    packing = options.pack, options.pack_red, options.pack_green, options.pack_blue, options.pack_alpha
    return options.normal + _others(options.maps, packing)


@functools.lru_cache
def _others(maps: tuple[str, ...], packing: tuple[str, ...]) -> int:
    names = "pack", "pack_red", "pack_green", "pack_blue", "pack_alpha"
    return len(Settings(maps=maps, **dict(zip(names, packing, strict=True))).drawn_maps)
