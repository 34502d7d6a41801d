# SPDX-License-Identifier: GPL-3.0-or-later
"""What bakes cost, so that a run can be divided into parts that take about the same time."""

import argparse
import functools

from ...core.settings import Settings
from . import run_clashes


def cost(options: argparse.Namespace) -> int:
    """The cost of a bake: the samples of all texels of its maps.

    It depends on the options alone, so that it is the same on every machine, also where a file is missing or was changed.
    """
    maps = 1 if options.convert else max(1, _maps(options))
    samples = 1 if options.convert else options.samples
    texels = options.size[0] * options.size[1] * max(1, len(options.tiles)) * max(1, len(run_clashes.frames(options)))
    return texels * samples * maps


def _maps(options: argparse.Namespace) -> int:
    """How many maps are drawn."""
    packing = options.pack, options.pack_red, options.pack_green, options.pack_blue, options.pack_alpha
    return options.normal + _others(options.maps, packing)


@functools.lru_cache
def _others(maps: tuple[str, ...], packing: tuple[str, ...]) -> int:
    names = "pack", "pack_red", "pack_green", "pack_blue", "pack_alpha"
    return len(Settings(maps=maps, **dict(zip(names, packing, strict=True))).drawn_maps)
