# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodes texels as image files: PNG, DDS and KTX2 by writers of its own, all other formats by OpenImageIO, which most builds
of Blender contain. Without it, Blender itself reads PNG files."""

import importlib
import os
import struct
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePath
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple

import bpy
import numpy as np

from ..blocks import decoding
from ..blocks.formats import BC5, BC7, BlockFormat, Purpose
from ..core import file_formats, foreach, threads
from ..core.errors import BakeError
from ..core.file_formats import FileFormat
from ..core.file_structure import whole_files
from ..passes import block_encoding
from . import containers, png_writer, value_encoding, webp_notes
from .atomic_file import Partial
from .containers import Container
from .write_queue import Content, WriteQueue, for_rows, top_first

TARGA_END = b"TRUEVISION-XFILE.\0"
"""The last bytes of a complete Targa file."""


class _Encoding(NamedTuple):
    """How OpenImageIO writes a format: its name there, and the attributes of the image beside those of all formats."""

    name: str
    attributes: Mapping[str, str | int | float]


_OF_ALL = MappingProxyType(
    {
        "oiio:UnassociatedAlpha": 1,  # colors are stored as they are, not multiplied with alpha
        "DateTime": "0000:00:00 00:00:00",  # otherwise the current time: equal bakes would make different files
    }
)
_ENCODINGS: Mapping[FileFormat, _Encoding] = MappingProxyType(
    {
        file_formats.OPEN_EXR: _Encoding("openexr", {"compression": "zip", "colorInteropID": "lin_rec709_scene"}),
        # A higher quality takes three times as long, for files that are 3 % smaller.
        file_formats.TIFF: _Encoding(
            "tiff",
            {"compression": "zip", "tiff:zipquality": 4}
            | {"XResolution": 72.0, "YResolution": 72.0, "ResolutionUnit": "in"},
        ),
        file_formats.TARGA: _Encoding("targa", {"compression": "none"}),
        file_formats.WEBP: _Encoding("webp", {}),
        file_formats.JPEG: _Encoding(
            "jpeg", {"jpeg:subsampling": "4:4:4"}
        ),  # data has no colors that the eye sees less
    }
)


_WITH_ALPHA = 4, 6
"""The kinds of colors of PNG files that have alpha."""
KEYWORD, ATTRIBUTE = "Imprint", "ImageDescription"
"""Where a file has its note: the keyword of a text in PNG files, and OpenImageIO's name in all others."""


@dataclass(frozen=True)
class Format:
    """How texels are stored.

    Attributes:
        size: Width and height.
        depth: Bits per channel.
        has_alpha: Whether alpha is stored.
        is_float: Whether values are floats.
    """

    size: tuple[int, int]
    depth: int
    is_float: bool
    has_alpha: bool = True

    def __str__(self) -> str:
        kind = "-bit floats" if self.is_float else " bits"
        return (
            f"{self.size[0]} x {self.size[1]} texels of {self.depth}{kind}{'' if self.has_alpha else ' without alpha'}"
        )


def content(
    texels: np.ndarray,
    path: Path,
    depth: int,
    *,
    has_alpha: bool = True,
    is_color: bool = False,
    is_gray: bool = False,
    note: str = "",
    quality: int = 100,
    blocks: "Blocks | None" = None,
) -> Content:
    """The file of `texels` in the format that the ending of `path` names. The texels may change afterwards.

    Blocks are encoded at once, on the GPU: call this from the main thread. Raises BakeError for a size that the format does not
    take.

    Args:
        texels: (height, width, 4) float32, row 0 at v = 0. Values are stored as they are, whatever alpha is.
        depth: Bits per channel.
        is_color: Whether values are sRGB, which PNG files and those of blocks declare.
        is_gray: Whether red stands for all colors. Then a file has one channel, if its format has that: beside alpha in PNG
            alone.
        quality: Of formats that have it: 100 is without losses, or with the least.
        blocks: How formats of blocks store the texels.
        note: A text in ASCII for the file's metadata, which `note_of` reads.
    """
    file_format = file_formats.of(path)
    if file_format is file_formats.PNG:
        texts = {KEYWORD: note} if note else {}
        return png_writer.content(texels, depth, has_alpha=has_alpha, is_color=is_color, is_gray=is_gray, texts=texts)
    if file_format.is_blocks:
        return (blocks or Blocks(BC7)).content(texels, path, has_alpha=has_alpha, is_color=is_color, note=note)
    has_alpha &= file_format.has_alpha
    is_single = is_gray and not has_alpha and file_format in (file_formats.TIFF, file_formats.JPEG)
    texels = top_first(texels, has_alpha, is_gray=is_single)
    numbers = _numbers(texels, depth, is_float=file_format.is_float)

    def write(path: Path, _results: Iterator) -> None:
        path.open("wb").close()  # raises the error of the system, which OpenImageIO does not name
        _write(numbers, path, file_format, ({ATTRIBUTE: note} if note else {}) | _packing(file_format, quality))
        if note and file_format is file_formats.WEBP:  # in which OpenImageIO stores no texts
            webp_notes.add(path, note)

    return Content([], write)


BACKGROUND = 1 / 16
"""How much a texel that no island covers counts beside one that is covered. Only filtering shows it."""


@dataclass(frozen=True)
class Blocks:
    """How texels become blocks.

    Attributes:
        purpose: What the encoder keeps small.
        levels: The texels of the mip levels from 1 on, as those of the map.
        has_map_in_alpha: Whether alpha holds a map, rather than 0 where no island covers a texel.
        first: The blocks of level 0, if they were made before, by the same settings.
    """

    block_format: BlockFormat
    purpose: Purpose = Purpose.DATA
    levels: Sequence[np.ndarray] = ()
    has_map_in_alpha: bool = False
    first: np.ndarray | None = None

    def content(self, texels: np.ndarray, path: Path, *, has_alpha: bool, is_color: bool, note: str) -> Content:
        """The file of texels, as the function `content` describes it."""
        file_formats.check_size(path, (texels.shape[1], texels.shape[0]))
        held = self.container(texels, has_alpha=has_alpha, is_color=is_color, note=note)
        return Content([], lambda path, _results: containers.write(path, held))

    def container(self, texels: np.ndarray, *, has_alpha: bool, is_color: bool, note: str) -> Container:
        """What such a file holds."""
        size = texels.shape[1], texels.shape[0]
        has_alpha &= self.block_format.channels == 4
        first = self._encoded(texels, has_alpha=has_alpha) if self.first is None else self.first
        levels = [first, *(self._encoded(each, has_alpha=has_alpha) for each in self.levels)]
        return Container(size, levels, self.block_format, is_color and not self.block_format.is_float, has_alpha, note)

    def kept(self, texels: np.ndarray, *, has_alpha: bool) -> np.ndarray:
        """What GPUs read of texels, as the function `content` takes them, once they are blocks. Alpha stays the same."""
        has_alpha &= self.block_format.channels == 4
        blocks = self._encoded(texels, has_alpha=has_alpha)
        size = texels.shape[1], texels.shape[0]
        shown = decoded(Container(size, [blocks], self.block_format, False, has_alpha, ""))
        shown[..., 3] = texels[..., 3]
        return shown

    def _encoded(self, texels: np.ndarray, *, has_alpha: bool) -> np.ndarray:
        texels = containers.padded(texels[::-1])
        weights = None
        if not self.has_map_in_alpha:
            weights = np.where(texels[..., 3] > 0.0, np.float32(1.0), np.float32(BACKGROUND))
        texels = np.ascontiguousarray(texels)  # a copy: the rows were upside down
        if not has_alpha:
            texels[..., 3] = 1.0
        return block_encoding.encoded(texels, self.block_format, self.purpose, weights)


def after_losses(texels: np.ndarray, path: str | Path, quality: int, *, has_alpha: bool = False) -> np.ndarray:
    """What is read of texels of 8 bits, as `content` takes them, from a file of this quality in the format that the ending of
    `path` names. Alpha stays the same. Raises BakeError."""
    with tempfile.TemporaryDirectory(prefix="imprint-") as folder:
        file = Path(folder, "map").with_suffix(PurePath(path).suffix)
        content(texels, file, 8, has_alpha=has_alpha, quality=quality).write(file, iter(()))
        shown = read(file)
    shown[..., 3] = texels[..., 3]
    return shown


def _packing(file_format: FileFormat, quality: int) -> dict[str, str]:
    """The attribute of the quality in OpenImageIO, for formats that have one."""
    if not file_format.has_quality:
        return {}
    is_exact = quality == 100 and file_format is file_formats.WEBP
    return {"compression": "lossless" if is_exact else f"{_ENCODINGS[file_format].name}:{quality}"}


def note_of(path: str | Path) -> str:
    """The note in the metadata of a file; empty if it has none, or is no image. Raises BakeError for one that the system does
    not let read, which may have one."""
    try:
        if file_formats.of(path) is file_formats.PNG:
            return png_writer.texts(path).get(KEYWORD, "")
        if file_formats.of(path) is file_formats.WEBP:
            return webp_notes.read(path)
        with open(path, "rb") as file:  # OpenImageIO does not tell such a file from one that is no image
            file.read(1)
    except OSError as error:
        raise BakeError(f"{str(path)!r} could not be read: {error.strerror}.") from error
    try:
        if file_formats.of(path).is_blocks:
            return containers.head_of(path).note
        with _opened(path) as (picture, _):
            note = str(picture.spec().getattribute(ATTRIBUTE) or "")
    except BakeError:
        return ""
    # OpenImageIO puts a line break between the lines of a comment, which have no more than 80 letters.
    return note.replace("\n", "") if file_formats.of(path) is file_formats.TARGA else note


def format_of(path: str | Path) -> Format:
    """How a file stores its texels. Raises BakeError."""
    if file_formats.of(path).is_blocks:
        return _format_of(containers.head_of(path))
    if _is_for_blender(path):
        return _format_of_png(path)
    with _opened(path) as (_, stored_as):
        return stored_as


def read(path: str | Path) -> np.ndarray:
    """The texels (height, width, 4) float32 of a file, row 0 at v = 0, that `content` would store as they are there. Raises
    BakeError."""
    if file_formats.of(path).is_blocks:
        return decoded(containers.read(path))
    if _is_for_blender(path):
        return _read_by_blender(path)
    with _opened(path) as (picture, stored_as):
        spec = picture.spec()
        colors = spec.nchannels - stored_as.has_alpha
        has_depth = spec.z_channel == spec.nchannels - 1 and spec.nchannels in (2, 4)  # X, Y, Z are a vector
        if has_depth or not 1 <= colors <= 3:
            raise BakeError(
                f"{str(path)!r} has the channels {', '.join(spec.channelnames)}: give a file of gray, or of red, green and "
                "blue, with alpha at most."
            )
        numbers = picture.read_image(0, 0, 0, spec.nchannels, _number_type(stored_as))
        if numbers is None:
            raise BakeError(f"{str(path)!r} could not be read: {picture.geterror()}.")
    texels = np.ones((*numbers.shape[:2], 4), np.float32)
    if colors == 2:
        texels[..., :2], texels[..., 2] = numbers[..., :2], 0.0
    else:
        texels[..., :3] = numbers[..., :colors]
    if stored_as.has_alpha:
        texels[..., 3] = numbers[..., -1]
    if not stored_as.is_float:
        texels[..., : 3 + stored_as.has_alpha] /= np.float32(2**stored_as.depth - 1)
    return np.ascontiguousarray(texels[::-1])


def decoded(container: Container, level: int = 0) -> np.ndarray:
    """The texels (height, width, 4) float32 of a mip level, row 0 at v = 0. Gray for one channel; of two, blue is rebuilt as
    that of a unit normal that points up. Raises BakeError."""
    width, height = containers.level_size(container.size, level)
    values = decoding.decoded(container.levels[level], container.block_format)[:height, :width][::-1]
    texels = np.ones((height, width, 4), np.float32)
    if container.block_format is BC5:
        texels[..., :2] = values
        x, y = values[..., 0] * 2.0 - 1.0, values[..., 1] * 2.0 - 1.0
        texels[..., 2] = 0.5 + 0.5 * np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    else:
        texels[..., :3] = values[..., :3]
    if container.has_alpha:
        texels[..., 3] = values[..., 3]
    return texels


def _format_of(container: Container) -> Format:
    is_float = container.block_format.is_float
    return Format(container.size, value_encoding.HALF if is_float else 8, is_float, container.has_alpha)


def _is_for_blender(path: str | Path) -> bool:
    """Whether Blender reads a file: a PNG file, where OpenImageIO is not there."""
    if file_formats.of(path) is not file_formats.PNG:
        return False
    try:
        _library()
    except BakeError:
        return True
    return False


def _format_of_png(path: str | Path) -> Format:
    """How a PNG file stores its texels, as ISO/IEC 15948 has its head. Raises BakeError."""
    head = struct.Struct(">8x8s2I2B")
    try:
        with open(path, "rb") as file:
            kind, width, height, depth, color = head.unpack(file.read(head.size))
    except (OSError, struct.error) as error:
        raise BakeError(f"{str(path)!r} could not be read: {error}.") from error
    if kind[4:] != b"IHDR":
        raise BakeError(f"{str(path)!r} could not be read: it is no PNG file.")
    return Format((width, height), max(8, depth), False, color in _WITH_ALPHA)


def _read_by_blender(path: str | Path) -> np.ndarray:
    """The texels of a PNG file, as the function `read` has them. Raises BakeError."""
    most = np.float32(2 ** _format_of_png(path).depth - 1)
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        image.colorspace_settings.is_data, image.alpha_mode = True, "CHANNEL_PACKED"  # texels as they are stored
        texels = foreach.pixels(image)
    finally:
        bpy.data.images.remove(image)
    if not texels.size:
        raise BakeError(f"{str(path)!r} could not be read.")
    return np.rint(texels * most) / most  # Blender divides in another way


@contextmanager
def _opened(path: str | Path) -> Iterator[tuple[Any, Format]]:
    """A file in OpenImageIO, and how it stores its texels. Raises BakeError."""
    library = _library()
    wanted = library.ImageSpec()
    for name, value in _OF_ALL.items():
        wanted.attribute(name, value)
    picture = library.ImageInput.open(os.fsencode(path), wanted)
    if picture is None:
        raise BakeError(f"{str(path)!r} could not be read: {library.geterror()}.")
    try:
        spec = picture.spec()
        kind = np.dtype({"half": "f2", "float": "f4"}.get(str(spec.format), str(spec.format)))
        size = spec.width, spec.height
        # TIFF files need not say what a fourth channel is.
        has_alpha = spec.nchannels == 4 or spec.alpha_channel == spec.nchannels - 1 > 0
        yield picture, Format(size, 8 * kind.itemsize, kind.kind == "f", has_alpha)
    finally:
        picture.geterror()
        picture.close()


def _number_type(stored: Format) -> str:
    return _type_name(np.dtype(f"{'f' if stored.is_float else 'u'}{stored.depth // 8}"))


def write(
    texels: np.ndarray, path: Path, depth: int, *, has_alpha: bool = True, is_color: bool = False, quality: int = 100
) -> None:
    """Write a file as described at `content`, and wait until it is there. Raises BakeError if that fails."""
    partial = Partial(path)
    try:
        with WriteQueue() as queue:
            how = {"has_alpha": has_alpha, "is_color": is_color, "quality": quality}
            queue.add(lambda: content(texels, path, depth, **how), partial).result()
        partial.commit()
    finally:
        partial.discard()


def check_format(path: str | Path) -> None:
    """Raise BakeError if this Blender cannot write files in the format of `path`."""
    file_format = file_formats.of(path)
    if file_format is file_formats.PNG or file_format.is_blocks:
        return
    if file_format.has_quality and _library().ImageOutput.create(_ENCODINGS[file_format].name) is None:
        _library().geterror()
        raise BakeError(f"This Blender's OpenImageIO does not write {file_format.label} files: choose PNG.")
    _library()


@cache
def _library() -> ModuleType:
    """OpenImageIO. Raises BakeError if this Blender was built without its Python module."""
    # Blender itself finds it; as a Python package, Blender does not search the folder with its own modules.
    own = [str(path) for path in Path(bpy.utils.resource_path("LOCAL"), "python").rglob("site-packages")]
    sys.path += own
    try:
        library = importlib.import_module("OpenImageIO")
    except ImportError as error:
        raise BakeError(
            "This Blender lacks the Python module OpenImageIO, which writes files other than PNG, DDS and KTX2: choose "
            "PNG, or install the module (the package python3-openimageio on Debian and Ubuntu)."
        ) from error
    finally:
        del sys.path[len(sys.path) - len(own) :]
    # It counts processors that a container may not use; and with two, TIFF files would be packed by one.
    library.attribute("threads", max(3, threads.processors()))
    return library


def _numbers(texels: np.ndarray, depth: int, *, is_float: bool) -> np.ndarray:
    """`texels` (height, width, channels) as a file stores them: floats, or steps from 0 to 1. Contiguous."""
    kind = np.dtype(f"{'f' if is_float else 'u'}{depth // 8}")
    result = np.empty(texels.shape, kind)

    def work(blocks: Iterator[slice]) -> None:
        for rows in blocks:
            values = texels[rows]
            if not is_float:
                result[rows] = value_encoding.steps(values, depth)
            elif depth == value_encoding.HALF:
                np.clip(
                    values, -value_encoding.MOST_HALF, value_encoding.MOST_HALF, out=result[rows], casting="same_kind"
                )
            else:
                result[rows] = values

    for_rows(len(texels), result[:1].nbytes, work)
    return result


def _write(numbers: np.ndarray, path: Path, file_format: FileFormat, more: Mapping[str, str]) -> None:
    """Write a file with OpenImageIO. Raises RuntimeError if not all of it could be written."""
    library, encoding = _library(), _ENCODINGS[file_format]
    height, width, channels = numbers.shape
    spec = library.ImageSpec(width, height, channels, _type_name(numbers.dtype))
    for name, value in (_OF_ALL | encoding.attributes | more).items():
        spec.attribute(name, value)
    output = library.ImageOutput.create(encoding.name)
    is_written = output.open(os.fsencode(path), spec) and output.write_image(numbers)
    output.close()
    output.geterror()  # forgets it: OpenImageIO prints what is not asked for, and some errors have no cause
    # On a full disk, the last bytes of a file can be lost without an error.
    if not is_written or not _is_complete(path, numbers[-1], file_format):
        raise RuntimeError("OpenImageIO could not write all of it, as on a full disk")


def _type_name(kind: np.dtype) -> str:
    return {"f2": "half", "f4": "float"}.get(kind.str[1:], kind.name)


def _is_complete(path: Path, last_row: np.ndarray, file_format: FileFormat) -> bool:
    """Whether the end of a file is as it was written."""
    if file_format is file_formats.TARGA:  # OpenImageIO would read all of it
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - len(TARGA_END)))
            return file.read() == TARGA_END
    if file_format.has_quality:  # what was lossy has another last row
        return not whole_files.problem(str(path), is_image=True)
    try:
        with _opened(path) as (picture, _):
            row = picture.read_scanline(picture.spec().height - 1, 0, _type_name(last_row.dtype))
    except BakeError:
        return False
    return row is not None and row.tobytes() == last_row.tobytes()
