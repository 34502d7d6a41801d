# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of images, also packed ones: where they are, and the size that their headers state."""

import io
from typing import BinaryIO

import bpy
from bpy.types import Image

from ...core import udim
from ...core.file_structure.image_headers import image_size, is_of_whole_numbers


def location(image: Image, tile: int) -> str:
    """The path of the file of an image, or of a UDIM tile if `tile` is not 0; empty for an image without one."""
    if not image.filepath:
        return ""
    path = udim.fill_all(image.filepath, tile) if tile else image.filepath
    return bpy.path.abspath(path, library=image.library)


def packed_data(image: Image, tile: int) -> bytes | None:
    """The packed file of an image, or of a tile if `tile` is not 0; None if it is not packed."""
    files = (file for file in image.packed_files if file.packed_file and tile in (0, file.tile_number))
    return next((file.packed_file.data for file in files), None)


def header_size(image: Image, tile: int) -> tuple[int, int] | None:
    """Width and height by the header of the file: (0, 0) without a file, None for a header that is not known."""
    try:
        with _opened(image, tile) as file:
            return image_size(file)
    except OSError:
        return 0, 0


def has_whole_numbers(image: Image, tile: int) -> bool:
    """Whether the file, by its header, stores shares of a largest number: no value is below 0 or above 1."""
    try:
        with _opened(image, tile) as file:
            return is_of_whole_numbers(file)
    except OSError:
        return False


def _opened(image: Image, tile: int) -> BinaryIO:
    """The file, packed or not. Raises OSError if there is none."""
    data = packed_data(image, tile)
    return open(location(image, tile), "rb") if data is None else io.BytesIO(data)
