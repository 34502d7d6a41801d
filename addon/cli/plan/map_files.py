# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the maps of a bake, from its options. Names are made once for all bakes whose settings differ only in names."""

import argparse
import functools
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...core import udim
from ...core.file_formats import BY_ENDING
from ...core.names import file_names
from ...output import map_names
from ...output.files import frame_files, planned_files
from ..usage import option_settings

_START = os.path.join(os.path.abspath(os.sep), "T_x")
"""Stands for the start of paths. The names of other maps are short only after T_."""


def files(options: argparse.Namespace, low: str, of_frames: Sequence[int] = ()) -> Iterator[tuple[str, str]]:
    """The files that a bake of the object `low` writes, as planned_files.files returns them."""
    if of_frames:
        settings = frame_files.filled(option_settings.settings(options), low)
        for frame in of_frames:
            yield from planned_files.files(frame_files.of_frame(settings, frame))
        return
    path = file_names.fill(os.path.abspath(options.output), low)
    head, ending = os.path.splitext(path)
    name = os.path.basename(head)
    tail = map_names.own_end(name)
    if udim.TOKEN in path or "\n" in path or name == tail or ending.lower() not in BY_ENDING:
        yield from planned_files.files(replace(option_settings.settings(options), output=path))
        return
    start = head.removesuffix(tail)
    for rest, title in _endings(option_settings.kind(options), tail + ending):
        yield start + rest, title


@functools.lru_cache(maxsize=4096)
def _endings(values: tuple, ending: str) -> list[tuple[str, str]]:
    """The files of maps of a kind, without the start of their paths, which is common to all."""
    settings = option_settings.settings(option_settings.of_kind(values, _START + ending))
    return [(path.removeprefix(_START), title) for path, title in planned_files.files(settings)]
