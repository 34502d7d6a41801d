# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the frames of an animation. This module does not need Blender."""

import re
from dataclasses import replace
from pathlib import PurePath

from ...core import naming
from ...core.settings import Settings


def output_for(output: str, frame: int) -> str:
    """The file of a frame: its number replaces the last run of # in the name, or is added before the ending, as _0001."""
    path = PurePath(output)
    runs = list(re.finditer("#+", path.stem))
    if not runs:
        return str(path.with_stem(f"{path.stem}_{frame:04}"))
    start, stop = runs[-1].span()
    return str(path.with_stem(f"{path.stem[:start]}{frame:0{stop - start}}{path.stem[stop:]}"))


def filled(settings: Settings, low_name: str) -> Settings:
    """The settings with the low object's name in the path. A # in that name is replaced, because it means a frame."""
    return replace(settings, output=naming.fill(settings.storing.output, low_name.replace("#", "_")))


def of_frame(settings: Settings, frame: int) -> Settings:
    """The settings of one frame, from those with the low object's name filled in."""
    return replace(settings, output=output_for(settings.storing.output, frame))
