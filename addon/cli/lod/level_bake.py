# SPDX-License-Identifier: GPL-3.0-or-later
"""The bake of the command `lod`: it makes the levels and their maps."""

import argparse

import bpy

from ...core.levels import level_report
from ...core.levels.level_report import ChainReport
from ...core.progress import Pace, Task
from ...core.settings import Settings
from ...jobs.lod import level_chain


def names(options: argparse.Namespace, source: bpy.types.Object) -> list[str]:
    """The names of the levels of `source`."""
    return level_chain.names(source, len(level_report.limits(*options.levels)))


def work(options: argparse.Namespace, source: bpy.types.Object, settings: Settings, pace: Pace) -> Task[ChainReport]:
    """As level_chain.work, with the limits in the options."""
    return level_chain.work(bpy.context, source, level_report.limits(*options.levels), settings, pace)
