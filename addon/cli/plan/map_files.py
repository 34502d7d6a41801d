# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the maps of a bake, from its options. Names are made once for all bakes whose settings differ only in names."""

import argparse
import functools
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...core import udim
from ...core.file_formats import BY_ENDING
from ...core.names import file_names
from ...output.files import frame_files, planned_files
from ..usage import option_settings

_NORMAL = re.compile(r"[._ -]normal$", re.IGNORECASE)
"""An ending of names that the names of other maps do not have."""


def files(options: argparse.Namespace, low: str, of_frames: Sequence[int] = ()) -> Iterator[tuple[str, str]]:
    """The files that a bake of the object `low` writes, as planned_files.files returns them."""
    if of_frames:
        settings = frame_files.filled(option_settings.settings(options), low)
        for frame in of_frames:
            yield from planned_files.files(frame_files.of_frame(settings, frame))
        return
    path = file_names.fill(os.path.abspath(options.output), low)
    head, ending = os.path.splitext(path)
    tail = found[0] if (found := _NORMAL.search(head)) else ""
    head = head.removesuffix(tail)
    if udim.TOKEN in path or "\n" in path or not os.path.basename(head) or ending.lower() not in BY_ENDING:
        yield from planned_files.files(replace(option_settings.settings(options), output=path))
        return
    for rest, title in _endings(option_settings.kind(options), tail + ending):
        yield head + rest, title


@functools.lru_cache(maxsize=4096)
def _endings(values: tuple, ending: str) -> list[tuple[str, str]]:
    """The files of maps of a kind, without the start of their paths, which is common to all."""
    start = os.path.join(os.path.abspath(os.sep), "x")
    settings = option_settings.settings(option_settings.of_kind(values, start + ending))
    return [(path.removeprefix(start), title) for path, title in planned_files.files(settings)]
