# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of images, also packed ones: where they are, and the size that their headers state."""

import io

import bpy
from bpy.types import Image

from ...core import udim
from ...core.file_structure.image_headers import image_size


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
    data = packed_data(image, tile)
    if data is not None:
        return image_size(io.BytesIO(data))
    try:
        with open(location(image, tile), "rb") as file:
            return image_size(file)
    except OSError:
        return 0, 0
