# SPDX-License-Identifier: GPL-3.0-or-later
"""What bakes cost, so that a run can be divided into parts that take about the same time."""

import argparse

from ..usage import option_settings
from . import plans


def cost(options: argparse.Namespace) -> int:
    """The cost of a bake: the samples of all texels of its maps.

    It depends on the options alone, so that it is the same on every machine, also where a file is missing or was changed.
    """
    maps = options.normal + len(option_settings.settings(options).map.drawn_maps)
    texels = options.size[0] * options.size[1] * max(1, len(options.tiles)) * max(1, len(plans.frames(options)))
    return texels if options.convert else texels * options.samples * max(1, maps)
