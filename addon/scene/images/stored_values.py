# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the values of an image as its file stores them, whatever color space and alpha mode the image is set to."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Image

from ...core import udim
from ...core.errors import BakeError
from ..image_files import location, packed_data
from .image_pages import SINGLE, ImagePages, UnreadableError


def tiles(image: Image) -> tuple[int, ...]:
    """The UDIM tiles that have pixels; udim.FIRST alone for an image without tiles.

    Raises BakeError for an image without pixels: a missing file, a movie, a render.
    """
    try:
        found = ImagePages().page(image, is_premultiplied=False)
    except UnreadableError as error:
        raise BakeError(f"No normal map can be read: {error}.") from error
    return found.tiles or (udim.FIRST,)


def read(image: Image, tile: int) -> np.ndarray:
    """The stored values (height, width, 4) float32, row 0 at v = 0. tile: as `tiles` returns them. Raises BakeError."""
    number = tile if image.source == "TILED" else SINGLE
    with _as_data(image, number) as single:
        width, height = single.size
        if min(width, height) == 0:
            raise BakeError(f"The image {image.name!r} has no pixels: {location(image, number)} cannot be read.")
        pixels = np.empty(width * height * 4, np.float32)
        single.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)


@contextmanager
def _as_data(image: Image, tile: int) -> Iterator[Image]:
    """An image with the file of one tile as plain data; `image` itself if it has no file, or changes that are not saved."""
    data, path = packed_data(image, tile), location(image, tile)
    is_file = data is not None or (path and Path(path).is_file())
    if not is_file or (image.is_dirty and not tile):
        yield image
        return
    single = bpy.data.images.new("Imprint values", 1, 1)
    try:
        if data is not None:
            single.pack(data=data, data_len=len(data))
        else:
            single.filepath = path
        single.source = "FILE"
        single.colorspace_settings.is_data = True
        single.alpha_mode = "CHANNEL_PACKED"
        single.use_half_precision = False
        if data is None:
            single.reload()
        yield single
    finally:
        bpy.data.images.remove(single)
