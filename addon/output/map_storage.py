# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes one map into an image datablock and into files."""

import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import Future
from pathlib import Path

import bpy
import numpy as np

from ..core import file_formats, udim
from ..core.declarations.choices import Storage
from ..core.errors import BakeError, shorten_list
from ..core.settings import Settings, StorageSettings
from ..core.udim import TOKEN
from . import datablocks, image_file, value_encoding
from .files import atomic_file
from .files.atomic_file import Partial, check_writable
from .map_names import name_for, output_for
from .value_encoding import SRGB
from .write_queue import WriteQueue


def black_and_white(where: np.ndarray) -> np.ndarray:
    """Texels (height, width, 4) float32: white where `where`, (height, width) bool, is True, else black."""
    texels = np.ones((*where.shape, 4), np.float32)
    texels[..., :3] = where[..., None]
    return texels


def check(low_name: str, settings: Settings) -> None:
    """Raise BakeError if a map cannot be stored with these settings. Called before the bake."""
    _check_image(settings.storing.image or name_for(low_name, settings.storing))
    output = output_for(settings)
    if output.startswith("//") and not bpy.data.filepath:
        raise BakeError(f"{output!r} is relative to a .blend file that was never saved: save it first.")
    for path in filter(None, (output, _packed_tiles(settings))):
        image_file.check_format(path)
    if output:
        check_writable(_absolute(output))


def replaced(name: str, highs: Iterable[str]) -> str:
    """The high objects of the map in the image `name`, as a list for a message, if a bake from `highs` replaces that map.

    Empty if the image has no map, if its high objects are unknown, or if one of `highs` is among them.
    """
    before = datablocks.origin(name)
    return "" if set(before).intersection(highs) else shorten_list(map(repr, before))


def kept(texels: np.ndarray, settings: Settings) -> np.ndarray:
    """What an image or a file of these settings keeps of the normals in `texels` (height, width, 4) float32."""
    if _is_dithered(settings.storing):
        return value_encoding.dithered(texels)
    if not settings.storing.is_float:
        return value_encoding.rounded(texels, settings.storing.depth)
    is_half = settings.storing.storage == Storage.FILE and settings.storing.depth == 16
    return texels.astype(np.float16).astype(np.float32) if is_half else texels


def _packed_tiles(settings: Settings) -> str:
    """The name of the temporary files of UDIM tiles to pack, which Blender takes only from files, or ""."""
    if settings.storing.storage != Storage.PACK or not settings.sampling.udim:
        return ""
    return f"map.{TOKEN}{file_formats.PACKED[settings.storing.is_float].endings[0]}"


def _is_dithered(settings: StorageSettings) -> bool:
    return settings.dither and settings.depth == 8


class Writer:
    """Stores one map in an image datablock and in files. Before `commit`, no datablock or existing file changes.

    Tiles for files, and packed UDIM tiles, are encoded from when they are added, so that memory does not grow with their
    number, and threads write them while the caller goes on. Use it in a `with` block, or call `discard` at the end.

    is_normal: whether to measure the error of normals that are stored as integers. color_space: of the texels, as in
    color_spaces.assign. is_packed: whether alpha holds a map. queue: what writes the files. Without one, it
    has its own. has_image: whether an image datablock shows the files.
    """

    def __init__(
        self,
        low_name: str,
        settings: Settings,
        *,
        is_normal: bool = False,
        color_space: str = "",
        is_packed: bool = False,
        queue: WriteQueue | None = None,
        has_image: bool = True,
    ):
        self.name, self.settings, self.is_normal = (
            settings.storing.image or name_for(low_name, settings.storing),
            settings,
            is_normal,
        )
        self.color_space, self.is_packed, self.has_image = color_space, is_packed, has_image
        self._texels: np.ndarray | None = None
        self._partials: dict[int, Partial] = {}
        self._queue, self._is_own_queue = queue or WriteQueue(), queue is None
        self._written: list[Future] = []
        self._folder: tempfile.TemporaryDirectory | None = None
        self._path = output_for(settings)
        """The path of the files, as Blender spells it. Empty without files."""
        if tiles := _packed_tiles(settings):
            self._folder = tempfile.TemporaryDirectory(prefix="imprint-")
            self._path = str(Path(self._folder.name, tiles))
        self._angles: list[np.ndarray] = []
        self.tiles: list[int] = []
        """The tiles that were added."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.discard()

    def add(self, tile: int, texels: np.ndarray) -> None:
        """Add the map of one UDIM tile, (height, width, 4) float32 with row 0 at v = 0. Without UDIM, the tile is udim.FIRST.

        Its file is written later. Raises BakeError if that already failed. The texels must not change before `commit` unless
        they go into a file.
        """
        settings = self.settings
        self.tiles.append(tile)
        stored = texels  # Blender rounds
        if _is_dithered(settings.storing):
            stored = value_encoding.dithered(texels, with_alpha=self.is_packed)
        if self._path:
            partial = self._partials[tile] = Partial(self._of_tile(tile))
            # As in Blender's own packed images, floats have 32 bits.
            depth = (
                file_formats.OPEN_EXR.depths[-1]
                if self._folder and settings.storing.is_float
                else settings.storing.depth
            )
            with partial.writing():
                partial.temporary.touch()
            has_alpha, is_color = settings.storing.alpha or bool(self._folder), self.color_space == SRGB
            self._written.append(
                self._queue.add(
                    lambda: image_file.content(
                        stored, partial.temporary, depth, has_alpha=has_alpha, is_color=is_color
                    ),
                    partial,
                )
            )
        else:
            self._texels = stored
        if self.is_normal and not settings.storing.is_float:
            rounded = value_encoding.rounded(value_encoding.sample_texels(stored), settings.storing.depth)
            self._angles.append(value_encoding.angles_between(value_encoding.sample_texels(texels), rounded))

    @property
    def paths(self) -> list[str]:
        """The absolute paths of the files, by tile. Links are not resolved."""
        return [] if self._folder else [str(self._of_tile(tile)) for tile in sorted(self._partials)]

    def _of_tile(self, tile: int) -> Path:
        return _absolute(udim.fill(self._path, tile))

    @property
    def loss(self) -> dict[str, float]:
        """Median and maximum of the error of normals, in degrees. Empty if they are stored as floats."""
        if not self._angles:
            return {}
        angles = np.concatenate(self._angles)
        return {"median": float(np.median(angles)), "maximum": float(angles.max())} if len(angles) else {}

    def commit(self) -> bpy.types.Image:
        """Store this map. See `commit_all`."""
        return commit_all([self])[0]

    def prepare(self) -> None:
        """Do everything that can fail or needs disk space, without changing existing files. Raises BakeError."""
        for file in self._written:
            file.result()
        if not self.has_image:
            return
        _check_image(self.name)  # again, because the user may have painted on it
        if self._path and self.settings.sampling.udim:
            self._keep_other_tiles()

    def put_files(self) -> None:
        """Replace the files. Raises BakeError if that fails."""
        for partial in self._partials.values():
            partial.commit()

    def show(self) -> bpy.types.Image:
        """Put the added texels into the image, and return it."""
        settings = self.settings
        if self._path:
            return datablocks.show(self.name, self._path, pack=self._folder is not None, color_space=self.color_space)
        pack = settings.storing.storage == Storage.PACK
        return datablocks.fill(
            self.name, self._texels, is_float=settings.storing.is_float, pack=pack, color_space=self.color_space
        )

    def discard(self) -> None:
        """Remove temporary files. Can be called at any time, and more than once. A queue of several writers must be closed."""
        if self._is_own_queue:
            self._queue.close()
        for partial in self._partials.values():
            partial.discard()
        if self._folder:
            self._folder.cleanup()

    def _keep_other_tiles(self) -> None:
        """Copy the tiles of the image that were not baked, unless they are in the files of this map already."""
        image = datablocks.get(self.name)
        if image is None or image.source != "TILED":
            return
        with next(iter(self._partials.values())).temporary.open("rb") as file:
            start = file.read(2)  # formats differ in their first bytes
        for tile, content in datablocks.tile_contents(image):
            partial = Partial(self._of_tile(tile))
            if tile in self._partials or (isinstance(content, Path) and content.resolve() == partial.path):
                continue
            with partial.writing():
                data = content.read_bytes() if isinstance(content, Path) else content
                is_there = partial.path.exists()
                if (data != partial.path.read_bytes()) if is_there else (data[:2] != start):
                    raise BakeError(
                        f"Tile {tile} of the image {self.name!r} would be lost: bake it as well, or choose another name."
                    )
                if not is_there:
                    self._partials[tile] = partial
                    partial.temporary.write_bytes(data)


def commit_all(writers: Sequence[Writer]) -> list[bpy.types.Image]:
    """Store the maps of all writers. Returns their images, of those that have one. They are channel-packed, and Non-Color but
    for those of colors.

    Raises BakeError if one of them fails; then no image or file has changed.
    """
    for writer in writers:
        writer.prepare()
    with atomic_file.all_or_none():
        for writer in writers:
            writer.put_files()
        return [writer.show() for writer in writers if writer.has_image]


def _check_image(name: str) -> None:
    image = datablocks.get(name)
    if image is None:
        return
    if (
        image.source not in {"GENERATED", "FILE", "TILED", *(["SEQUENCE"] if image.get("imprint") else [])}
        or image.type not in {"IMAGE", "UV_TEST"}
        or image.is_multiview
    ):
        raise BakeError(f"The image {name!r} is not a still image: choose another name for the map.")
    if image.source == "TILED" and image.is_dirty:
        raise BakeError(f"The image {name!r} has tiles with unsaved changes: save or pack it first.")


def _absolute(path: str) -> Path:
    return Path(bpy.path.abspath(path)).absolute()
