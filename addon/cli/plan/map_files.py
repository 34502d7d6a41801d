# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of the maps of a bake, from its options."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...core.names import file_names
from ...output.files import frame_files, planned_files
from ..usage import option_settings


def files(options: argparse.Namespace, low: str, of_frames: Sequence[int] = ()) -> Iterator[tuple[str, str]]:
    """The files that a bake of the object `low` writes, as planned_files.files returns them."""
    settings = option_settings.settings(options)
    if not of_frames:
        yield from planned_files.files(replace(settings, output=file_names.fill(settings.storing.output, low)))
    for frame in of_frames:
        yield from planned_files.files(frame_files.of_frame(frame_files.filled(settings, low), frame))
