# SPDX-License-Identifier: GPL-3.0-or-later
"""Loads the pixels of images as Blender's Image Texture node shows them or as their files store them, one image at a time."""

import io
import os
import struct
import time
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO, NamedTuple

import bpy
import numpy as np
from bpy.types import Image
from mathutils import Color

from ..core import foreach, udim
from ..core.errors import BakeError
from ..core.file_structure import whole_files
from ..core.file_structure.image_files import image_size, is_of_whole_numbers
from ..core.map_types import MARK, ORIGIN
from ..core.material_feeds import ImagePixels
from ..core.threads import for_blocks


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


PIXELS_AT_ONCE = 2**22
"""Pixels that `from_space` converts at once, to bound its memory."""


def srgb_to_linear(values: np.ndarray) -> np.ndarray:
    """Linear values of sRGB ones (IEC 61966-2-1), of any shape."""
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4)


def linearize_bytes(pixels: np.ndarray) -> None:
    """Make the color of sRGB pixels (N, 4) float32 linear in place. Takes their values as multiples of 1/255."""
    table = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)

    def convert(part: slice) -> None:
        colors = pixels[part, :3]
        np.take(table, (colors * 255.0 + 0.5).astype(np.uint8), out=colors, mode="clip")

    for_blocks(len(pixels), convert)


def is_converting() -> bool:
    """Whether Blender's working space is another than linear Rec.709, because the file says so."""
    return not np.allclose(_matrix(), np.eye(3), atol=1e-5)


def from_rec709(pixels: np.ndarray) -> None:
    """Convert the color of pixels (N, 4) float32 from linear Rec.709 to Blender's working space in place."""
    if not is_converting():
        return
    matrix = _matrix()

    def convert(part: slice) -> None:
        pixels[part, :3] = pixels[part, :3] @ matrix

    for_blocks(len(pixels), convert)


def _matrix() -> np.ndarray:
    """Takes row vectors of linear Rec.709 to Blender's working space, (3, 3) float32."""
    return np.array([Color(axis).from_rec709_linear_to_scene_linear() for axis in np.eye(3)], np.float32)


def from_space(pixels: np.ndarray, width: int, space: str) -> None:
    """Convert the color of byte pixels (H * width, 4) float32 from a color space of Blender's configuration, in place.

    Blender has no function for this. It converts images of 16 bits while it loads them, so temporary ones go through it.
    """
    step = max(1, PIXELS_AT_ONCE // width) * width
    for start in range(0, len(pixels), step):
        part = pixels[start : start + step]
        data = _png(np.rint(part[:, :3] * 255.0).astype(np.uint16) * 257, width)
        image = bpy.data.images.new("Imprint pixels", 1, 1)
        try:
            image.pack(data=data, data_len=len(data))
            image.source = "FILE"
            image.colorspace_settings.name = space
            converted = foreach.pixels(image).reshape(-1, 4)
        finally:
            bpy.data.images.remove(image)
        part[:, :3] = converted[:, :3]


def _png(values: np.ndarray, width: int) -> bytes:
    """An uncompressed PNG file of 16 bits of the colors (H * width, 3) uint16, the lowest row first."""
    rows = values.astype(">u2").view(np.uint8).reshape(-1, width * 6)[::-1]
    lines = np.zeros((len(rows), 1 + rows.shape[1]), np.uint8)  # the first byte of a line: no filter
    lines[:, 1:] = rows
    header = struct.pack(">IIBBBBB", width, len(rows), 16, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes(), 0)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )


SRGB, LINEAR = "sRGB", "Linear Rec.709"
"""Color spaces of Blender's own configuration. Blender itself converts the others."""


def prepare_texture(pixels: np.ndarray, width: int, image: Image, *, is_premultiplied: bool) -> ImagePixels:
    """Pixels (H * width, 4) float32 as Blender gives them for `image`, prepared in place.

    is_premultiplied: whether colors are multiplied with alpha.
    """
    space, is_data = image.colorspace_settings.name, image.colorspace_settings.is_data
    if image.alpha_mode == "NONE":
        pixels[:, 3] = 1.0
    has_alpha = has_alpha_in_colors(image) and not bool((pixels[:, 3] == 1.0).all())
    weighs_alpha = has_alpha and not is_premultiplied
    # Blender keeps bytes with straight alpha and floats with premultiplied alpha.
    multiply = has_alpha and is_premultiplied and not image.is_float
    divide = weighs_alpha and image.is_float
    if not image.is_float and not is_data and space == SRGB:
        if multiply:  # Blender's engines multiply stored values, before they are linear
            _multiply(pixels)
            _round_to_bytes(pixels)
        if not is_converting():
            return ImagePixels(pixels, is_srgb=True, is_byte=True, weighs_alpha=weighs_alpha)
        linearize_bytes(pixels)
        from_rec709(pixels)
        return ImagePixels(pixels, weighs_alpha=weighs_alpha)
    if not image.is_float and not is_data:  # Blender has converted floats
        if space == LINEAR:
            from_rec709(pixels)
        else:
            from_space(pixels, width, space)
    if multiply:
        _multiply(pixels)
    elif divide:
        _divide(pixels)
    is_raw = is_data or (space == LINEAR and not multiply and not is_converting())
    return ImagePixels(pixels, is_byte=is_raw and not image.is_float, weighs_alpha=weighs_alpha)


def has_alpha_in_colors(image: Image) -> bool:
    """Whether alpha has an influence on colors: not on data, nor where the image's alpha mode is Channel Packed or None."""
    return image.alpha_mode not in {"NONE", "CHANNEL_PACKED"} and not image.colorspace_settings.is_data


def _multiply(pixels: np.ndarray) -> None:
    def convert(part: slice) -> None:
        pixels[part, :3] *= pixels[part, 3:]

    for_blocks(len(pixels), convert)


def _divide(pixels: np.ndarray) -> None:
    def convert(part: slice) -> None:
        alpha = pixels[part, 3:]
        np.divide(pixels[part, :3], alpha, out=pixels[part, :3], where=alpha != 0.0)

    for_blocks(len(pixels), convert)


def _round_to_bytes(pixels: np.ndarray) -> None:
    def convert(part: slice) -> None:
        pixels[part, :3] = np.rint(pixels[part, :3] * 255.0) / 255.0

    for_blocks(len(pixels), convert)


PREMULTIPLIED = ":premultiplied"
"""The end of keys of textures whose colors are multiplied with alpha."""
_UNREADABLE = {
    "MOVIE": "a movie",
    "SEQUENCE": "an image sequence",
    "VIEWER": "an image of a viewer",
    "COMPOSITING": "an image of a viewer",
    "RENDER_RESULT": "a render",
    "MULTILAYER": "an image of several layers",
}
"""Sources and types of Blender's images that are not read."""
SINGLE = 0
"""The tile of an image without tiles."""
UNKNOWN = -np.inf, np.inf
"""The range of values that can be any."""


class UnreadableError(Exception):
    """An image without pixels for a map. The message is a clause that gives the reason."""


class ImageTexture(NamedTuple):
    """What feeds need from an image.

    Attributes:
        notes: Clauses about what is not read as Blender shows it.
    """

    key: str
    tiles: tuple[int, ...]
    notes: tuple[str, ...]


@dataclass
class ImageTextures:
    """The images of one bake's materials, by key. It keeps sizes, but no pixels."""

    _sizes: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)

    def texture(self, image: Image, *, is_premultiplied: bool) -> ImageTexture:
        """The key and the tiles of an image.

        Raises UnreadableError for an image without pixels: a missing file, a movie, a render.
        """
        kind = _UNREADABLE.get(image.source) or _UNREADABLE.get(image.type)
        if kind is not None:
            raise UnreadableError(f'the image "{image.name}" is {kind}')
        tiles = tuple(tile.number for tile in image.tiles) if image.source == "TILED" else ()
        existing = tuple(tile for tile in tiles or (SINGLE,) if min(self._size(image, tile)) > 0)
        if not existing:
            if image.type in _UNREADABLE:  # Blender finds layers when it loads the file
                raise UnreadableError(f'the image "{image.name}" is {_UNREADABLE[image.type]}')
            raise UnreadableError(_missing_tile(image, (tiles or (SINGLE,))[0]))
        notes = [_missing_tile(image, tile) for tile in tiles if tile not in existing]
        notes += [note for tile in existing if (note := _cut(image, tile))]
        if image.source == "TILED" and image.is_dirty:
            notes.append(f'the image "{image.name}" has changes that are not saved, which the map does not have')
        # One key for both, where alpha has no influence on colors: then the texture is loaded once.
        is_premultiplied &= has_alpha_in_colors(image)
        key = f"{image.session_uid}{PREMULTIPLIED if is_premultiplied else ''}"
        return ImageTexture(key, existing if tiles else (), tuple(notes))

    def range(self, image: Image) -> tuple[float, float]:
        """Within which all values of an image are, as far as that is known without its pixels."""
        space = image.colorspace_settings
        if not space.is_data and (space.name not in {SRGB, LINEAR} or is_converting()):
            return UNKNOWN
        tile = image.tiles[0].number if image.source == "TILED" else SINGLE
        is_as_stored = image.source != "GENERATED" and not image.is_dirty
        is_loaded = image.source == "GENERATED" or image.has_data
        is_whole = (is_as_stored and has_whole_numbers(image, tile)) or (is_loaded and not image.is_float)
        return (0.0, 1.0) if is_whole else UNKNOWN

    def measured_range(self, key: str, tiles: Collection[int] = ()) -> tuple[float, float]:
        """The smallest and the largest value of the pixels of an image. Loads them."""
        arrays = [self.load(key, tile).values for tile in tiles or (SINGLE,)]
        return min(float(values.min()) for values in arrays), max(float(values.max()) for values in arrays)

    def name(self, key: str) -> str:
        """The name of the image behind a key, for messages. Raises BakeError if the image is gone."""
        return _image_of(key).name

    def is_map(self, key: str) -> bool:
        """Whether Imprint baked an image. Raises BakeError if the image is gone."""
        image = _image_of(key)
        return bool(image.get(ORIGIN) or image.get(MARK))

    def size(self, key: str, tile: int = SINGLE) -> tuple[int, int]:
        """Width and height in pixels. Raises BakeError if the image is gone."""
        return self._size(_image_of(key), tile)

    def load(self, key: str, tile: int = SINGLE) -> ImagePixels:
        """The pixels of a texture, in a new array for each call.

        Colors are scene-linear, except that sRGB of 8 bits stays as it is stored; they are multiplied with alpha if the key
        says so. Images of data (Non-Color) have their stored values. Raises BakeError if the image has no pixels any more.
        """
        image = _image_of(key)
        with _loaded(image, tile) as single:
            width, height = single.size
            if min(width, height) == 0:
                raise BakeError(f"A texture is missing: {_missing_tile(image, tile)}.")
            stored = _stored(single)
            pixels = prepare_texture(stored, width, single, is_premultiplied=key.endswith(PREMULTIPLIED))
        return replace(pixels, values=pixels.values.reshape(height, width, 4))

    def _size(self, image: Image, tile: int) -> tuple[int, int]:
        known = image.session_uid, tile
        if known not in self._sizes:
            self._sizes[known] = size_of(image, tile)
        return self._sizes[known]


def size_of(image: Image, tile: int = SINGLE) -> tuple[int, int]:
    """Width and height; (0, 0) for a file that is missing or cannot be read. Loads only files whose header is not known."""
    if not (image.has_data and tile == SINGLE):
        if image.source == "GENERATED":
            return image.generated_width, image.generated_height
        size = header_size(image, tile)
        if size is not None:
            return size
    with _loaded(image, tile) as single:
        return tuple(single.size)


_STARTED = time.time_ns()
"""Files that have not changed since then are as Blender has loaded them."""
_stamps: dict[int, tuple[int, ...]] = {}
"""Of the files of images that are loaded, by session_uid: what changes with them."""


def _reload_if_outdated(image: Image) -> None:
    """Load an image again if another program has written its file since: a viewport may show it, and keep it loaded."""
    if image.source != "FILE" or image.packed_file or image.is_dirty:
        return
    try:
        state = os.stat(location(image, SINGLE))
    except (OSError, ValueError):  # missing: what is loaded is all that there is
        return
    stamp = state.st_mtime_ns, state.st_size, state.st_ino
    is_same = _stamps.get(image.session_uid) == stamp
    is_old = image.session_uid not in _stamps and state.st_mtime_ns < _STARTED
    _stamps[image.session_uid] = stamp
    if not (is_same or is_old):
        image.reload()


@contextmanager
def _loaded(image: Image, tile: int) -> Iterator[Image]:
    """An image with the pixels of one tile. What this loads is freed at the end."""
    if tile != SINGLE:
        with _only_tile(image, tile) as copy:
            yield copy
        return
    was_loaded = image.has_data
    if was_loaded:
        _reload_if_outdated(image)
    try:
        yield image
    finally:
        if not was_loaded:
            image.buffers_free()


@contextmanager
def _only_tile(image: Image, tile: int) -> Iterator[Image]:
    """A temporary image with the pixels of one tile: Blender gives those of the first tile only."""
    data = packed_data(image, tile)
    single = image.copy() if data is None else bpy.data.images.new("Imprint tile", 1, 1)
    try:
        if data is None:
            for other in [other for other in single.tiles if other.number != tile]:
                single.tiles.remove(other)
        else:  # a copy with fewer tiles does not find its packed files
            single.pack(data=data, data_len=len(data))
            single.source = "FILE"
            single.alpha_mode = image.alpha_mode
            single.colorspace_settings.name = image.colorspace_settings.name
        yield single
    finally:
        bpy.data.images.remove(single)


def _stored(image: Image) -> np.ndarray:
    """Blender's pixels, (H * W, 4) float32: bytes as they are stored, floats of colors in its working space."""
    return foreach.pixels(image).reshape(-1, 4)


def _image_of(key: str) -> Image:
    uid = int(key.removesuffix(PREMULTIPLIED))
    image = next((image for image in bpy.data.images if image.session_uid == uid), None)
    if image is None:
        raise BakeError("An image of the high meshes was removed during the bake: bake again.")
    return image


def _cut(image: Image, tile: int) -> str:
    """A clause if the file of an image ends too early, which Blender fills with gray; else empty."""
    path = location(image, tile)
    if image.source == "GENERATED" or not path or packed_data(image, tile) is not None:
        return ""
    problem = whole_files.problem(path, is_image=True)
    return f'the image "{image.name}" is not whole: {path} {problem}' if problem == whole_files.CUT else ""


def _missing_tile(image: Image, tile: int) -> str:
    path = location(image, tile)
    return f'the image "{image.name}" has no pixels' + (f": {path} cannot be read" if path else "")


def stored_tiles(image: Image) -> tuple[int, ...]:
    """The UDIM tiles that have pixels; udim.FIRST alone for an image without tiles.

    Raises BakeError for an image without pixels: a missing file, a movie, a render.
    """
    try:
        texture = ImageTextures().texture(image, is_premultiplied=False)
    except UnreadableError as error:
        raise BakeError(f"No normal map can be read: {error}.") from error
    return texture.tiles or (udim.FIRST,)


def read_stored(image: Image, tile: int) -> np.ndarray:
    """The stored values (height, width, 4) float32, row 0 at v = 0. tile: as `tiles` returns them. Raises BakeError."""
    number = tile if image.source == "TILED" else SINGLE
    if note := _cut(image, number):
        raise BakeError(f"No normal map can be read: {note}.")
    with _as_data(image, number) as single:
        if min(single.size) == 0:
            raise BakeError(f"The image {image.name!r} has no pixels: {location(image, number)} cannot be read.")
        return foreach.pixels(single)


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
