# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses the writer of an image file by its format."""

from pathlib import Path
from types import MappingProxyType

import numpy as np

from ..core import file_formats
from .files.atomic_file import Partial
from .files.write_queue import WriteQueue
from .writers import exr_writer, png_writer, targa_writer, tiff_writer
from .writers.content import Content

WRITERS = MappingProxyType(
    {
        file_formats.PNG: png_writer.content,
        file_formats.OPEN_EXR: exr_writer.content,
        file_formats.TIFF: tiff_writer.content,
        file_formats.TARGA: targa_writer.content,
    }
)
"""The function of each format that makes the content of a file. See `content`."""


def content(texels: np.ndarray, path: Path, depth: int, *, has_alpha: bool = True, is_color: bool = False) -> Content:
    """The file of `texels`, (height, width, 4) float32 with row 0 at v = 0, in the format that the ending of `path` names.

    depth: bits per channel. is_color: whether values are sRGB; PNG alone can say so. Values are stored as they are, whatever
    alpha is. The texels may change afterwards.
    """
    return WRITERS[file_formats.of(path)](texels, depth, has_alpha=has_alpha, is_color=is_color)


def write(texels: np.ndarray, path: Path, depth: int, *, has_alpha: bool = True, is_color: bool = False) -> None:
    """Write a file as described at `content`, and wait until it is there. Raises BakeError if that fails."""
    partial = Partial(path)
    try:
        with WriteQueue() as queue:
            queue.add(lambda: content(texels, path, depth, has_alpha=has_alpha, is_color=is_color), partial).result()
        partial.commit()
    finally:
        partial.discard()
