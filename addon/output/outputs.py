# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores the maps of one bake in images, files and attributes: all of them, or none.

Nothing changes before `commit`. A bake that ends early leaves the `with` block of its Outputs, which removes what was written
beside the files.
"""

import functools
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any

import bpy
import numpy as np

from ..blocks import formats
from ..blocks.formats import Purpose
from ..core import file_formats, threads, udim
from ..core.declarations import targets
from ..core.declarations.choices import Compression, Space, Storage, VertexDomain
from ..core.errors import BakeError, Fix, shorten_list
from ..core.map_types import BY_NAME, MASK, MISSED, NORMAL, VECTOR_DISPLACEMENT, WRITTEN, Kind, Labeled, Map, MapType
from ..core.sentences import LOOK, NOTE, WRONG, Sentence, rated
from ..core.settings import Settings, StorageSettings
from ..core.udim import TOKEN
from ..passes import block_encoding
from . import atomic_file, auto_format, datablocks, image_file, journal, map_names, shared_maps, value_encoding
from .atomic_file import Partial, check_writable
from .auto_format import Chosen, Trial, Way
from .image_file import Blocks
from .map_names import name_for, output_for, settings_by_map, stored_maps
from .shared_maps import Part
from .value_encoding import SRGB
from .vertex_attributes import VertexMaps
from .write_queue import WriteQueue


def black_and_white(where: np.ndarray) -> np.ndarray:
    """Texels (height, width, 4) float32: white where `where`, (height, width) bool, is True, else black."""
    texels = np.ones((*where.shape, 4), np.float32)
    texels[..., :3] = where[..., None]
    return texels


def check_storage(low_name: str, settings: Settings) -> None:
    """Raise BakeError if a map cannot be stored with these settings. Called before the bake."""
    _check_image(settings.storing.image or name_for(low_name, settings.storing))
    output = output_for(settings)
    if output.startswith("//") and not bpy.data.filepath:
        raise BakeError(f"{output!r} is relative to a .blend file that was never saved: save it first.")
    if packed := _packed_tiles(settings):
        try:
            image_file.check_format(packed)
        except BakeError as error:
            raise BakeError(
                "UDIM tiles that are packed with more than 8 bits are OpenEXR files, for which this Blender lacks the Python "
                "module OpenImageIO: set Depth to 8, or Store to File with a PNG file."
            ) from error
    if output:
        for ending in map_names.open_endings(settings) or [PurePath(output).suffix]:
            image_file.check_format(f"map{ending}")
        check_writable(_absolute(output))


def replaced(name: str, highs: Iterable[str]) -> str:
    """The high objects of the map in the image `name`, as a list for a message, if a bake from `highs` replaces that map.

    Empty if the image has no map, if its high objects are unknown, or if one of `highs` is among them.
    """
    before = datablocks.origin(name)
    return "" if set(before).intersection(highs) else shorten_list(map(repr, before))


def kept(texels: np.ndarray, settings: Settings) -> np.ndarray:
    """What programs read of the normals in `texels` (height, width, 4) float32, row 0 at v = 0, from an image or a file of
    these settings, with a fixed format: another array, with the same alpha."""
    return _kept(texels, settings_by_map(settings).get(NORMAL.name, settings).storing)


def _kept(texels: np.ndarray, storing: StorageSettings) -> np.ndarray:
    """The same. storing: of the normal map."""
    if storing.is_blocks:
        block_format = formats.BY_NAME[storing.compression.lower()]
        return Blocks(block_format, Purpose.NORMAL).kept(texels, has_alpha=storing.has_alpha)
    if _is_dithered(storing):
        shown = value_encoding.dithered(texels)
    elif not storing.is_float:
        shown = value_encoding.rounded(texels, storing.depth)
    else:
        return texels.astype(np.float16).astype(np.float32) if storing.is_half else texels.copy()
    if not storing.is_lossy:
        return shown
    return image_file.after_losses(shown, storing.output, storing.quality, has_alpha=storing.has_alpha)


def _packed_tiles(settings: Settings) -> str:
    """The name of the temporary files of UDIM tiles to pack, which Blender takes only from files, or ""."""
    if settings.storing.storage != Storage.PACK or not settings.sampling.udim:
        return ""
    return f"map.{TOKEN}{file_formats.PACKED[settings.storing.is_float].endings[0]}"


def _is_dithered(storing: StorageSettings) -> bool:
    return storing.dither and storing.depth == 8 and not storing.is_blocks


COMPRESSED = 1 << 15
"""About so many texels of a tile are compressed to measure what that costs: BC7 takes seconds for many on a software driver."""


def _compressor(settings: Settings, map_type: MapType | None) -> str:
    """The format of blocks to which a target engine compresses a map that is no normal map; empty for none."""
    if map_type is None or settings.storing.is_blocks or not auto_format.has_steps(map_type):
        return ""
    formats_of_others = (targets.BY_NAME[name].compresses_others for name in settings.map.targets)
    return next(filter(None, formats_of_others), "")


class MapWriter:
    """Stores one map in an image datablock and in files. Before `commit`, no datablock or existing file changes.

    Tiles for files, and packed UDIM tiles, are encoded from when they are added, so that memory does not grow with their
    number, and threads write them while the caller goes on. Use it in a `with` block, or call `discard` at the end.

    is_normal: whether to measure the error of normals that are stored as integers. color_space: of the texels, as in
    `assign_color_space`. is_packed: whether alpha holds a map. is_gray: whether all colors of a texel are the same. purpose,
    is_signed, levels: of files of blocks, whether floats are below 0, and how many levels of each tile go into its file.
    map_type: of which the smallest format is looked for, if it has a limit. endings: among which that of its files is chosen;
    none if it is fixed. queue: what writes the files. Without one, it has
    its own. has_image: whether an image datablock shows the files. baked, kept: the parts of a map that several low objects
    share, and those whose texels stay as they are. kept_tiles: in which these
    were found.
    """

    def __init__(
        self,
        low_name: str,
        settings: Settings,
        *,
        is_normal: bool = False,
        color_space: str = "",
        is_packed: bool = False,
        is_gray: bool = False,
        purpose: Purpose = Purpose.DATA,
        is_signed: bool = False,
        levels: int = 1,
        map_type: MapType | None = None,
        endings: Sequence[str] = (),
        queue: WriteQueue | None = None,
        has_image: bool = True,
        baked: Sequence[Part] = (),
        kept: Sequence[Part] = (),
        kept_tiles: Collection[int] = (),
    ):
        self.parts, self.has_kept = [*baked, *kept], bool(kept)
        self._kept_tiles = kept_tiles
        self.name, self.settings = settings.storing.image or name_for(low_name, settings.storing), settings
        self.is_normal, self.is_packed, self.is_gray = is_normal, is_packed, is_gray
        self.color_space, self.has_image = color_space, has_image
        self._purpose, self._is_signed, self._levels = purpose, is_signed, levels
        self._map_type = map_type if map_type and auto_format.limit_of(settings, map_type) else None
        self._endings = endings
        self._compressor = _compressor(settings, map_type)
        self._steps_off: list[np.ndarray] = []
        """What it leaves of each tile."""
        self.chosen: dict[int, Chosen] = {}
        """How the file of each tile stores its map, if that was looked for; what was read of it until the tile is added."""
        self._sizes: dict[int, int] = {}
        """The bytes of these files."""
        self._waiting: dict[int, list[np.ndarray]] = {}
        """The levels of a tile that wait for the others."""
        self.backwards = 0
        """Texels whose normals lose the sign of z."""
        self._texels: np.ndarray | None = None
        self._partials: dict[int, Partial] = {}
        self._queue, self._is_own_queue = queue or WriteQueue(), queue is None
        self._written: list[Future] = []
        self._are_handed_over = False
        """Whether the files are a journal's."""
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

    def way_of(self, tile: int) -> Way:
        """How the file of a tile stores the map, which was added."""
        return self.chosen[tile].way if tile in self.chosen else Way(self.settings.storing)

    def choose(self, tile: int, texels: np.ndarray, is_covered: np.ndarray) -> Chosen | None:
        """Choose how the file of a tile stores the map, unless that is fixed. Arguments: as of `add`."""
        if self._map_type is None:
            return None
        if tile not in self.chosen:
            store = functools.partial(self._trial, texels)
            map_type, endings = self._map_type, self._endings
            chosen = auto_format.smallest(texels, is_covered, self.settings, map_type, store, endings=endings)
            self.chosen[tile] = chosen
            if self._endings:  # Blender shows tiles of one ending
                self._endings = [PurePath(chosen.way.storing.output).suffix]
        return self.chosen[tile]

    def _trial(self, texels: np.ndarray, way: Way) -> Trial:
        """Store the texels of a tile in one way, and read them."""
        storing = way.storing
        if storing.is_blocks:
            held = self._blocks(storing).container(
                texels, has_alpha=storing.has_alpha, is_color=self.color_space == SRGB, note=""
            )
            return Trial(image_file.decoded(held), held.levels[0].nbytes, held.levels[0])
        texels = self._fitted(texels, way)
        with tempfile.TemporaryDirectory(prefix="imprint-") as folder:
            file = Path(folder, "map").with_suffix(PurePath(storing.output).suffix)
            made = image_file.content(texels, file, storing.depth, **self._how(storing))
            made.write(file, iter(threads.map_parallel(lambda part: part(), made.parts)))
            return Trial(image_file.read(file), file.stat().st_size)

    def _how(self, storing: StorageSettings) -> dict[str, Any]:
        """How image_file.content stores texels."""
        return {
            "has_alpha": storing.has_alpha or bool(self._folder),
            "is_color": self.color_space == SRGB,
            "is_gray": self.is_gray and not self._folder,
            "quality": storing.quality,
        }

    def _fitted(self, texels: np.ndarray, way: Way) -> np.ndarray:
        """The texels in the steps of a way, or dithered. They are rounded to its depth later."""
        storing = way.storing
        if way.step > 1:
            is_normal = self._purpose is Purpose.NORMAL
            return value_encoding.in_steps(texels, way.step, is_normal=is_normal, with_alpha=self.is_packed)
        return value_encoding.dithered(texels, with_alpha=self.is_packed) if _is_dithered(storing) else texels

    def add(
        self,
        tile: int,
        texels: np.ndarray,
        is_kept: np.ndarray | None = None,
        *,
        level: int = 0,
        is_covered: np.ndarray | None = None,
        way: Way | None = None,
    ) -> None:
        """Add the map of one UDIM tile, (height, width, 4) float32 with row 0 at v = 0. Without UDIM, the tile is udim.FIRST.

        level: of mip levels, which follow the map one by one, if they go into its file.

        is_kept: the texels (height, width) bool that stay as they are stored now if the map has kept parts; None for none.
        is_covered: those (height, width) bool that count when a format is chosen; None for all. way: how the map is stored
        of which this is a level.

        Its file is written later. Raises BakeError if that already failed. The texels must not change before `commit` unless
        they go into a file.
        """
        if level == 0:
            self.tiles.append(tile)
            self.choose(tile, texels, np.ones(texels.shape[:2], bool) if is_covered is None else is_covered)
        way = way or self.way_of(tile)
        storing = way.storing
        if self._path and not self._folder:
            self._path = map_names.with_ending(self._path, PurePath(storing.output).suffix)
        stored = self._fitted(texels, way)  # Blender rounds
        if level == 0 and self.is_normal and storing.is_blocks and storing.compression == Compression.BC5:
            self.backwards += int(np.count_nonzero((texels[..., 2] < 0.5) & (texels[..., 3] > 0.0)))
        if self.is_normal and level == 0:
            self._note_loss(texels, stored, storing)
        if self._compressor and level == 0 and is_covered is not None:
            self._note_compressed(texels, stored, is_covered)
        if self.has_kept and is_kept is not None:
            self._keep(tile, stored, is_kept)
        if self._path:
            waiting = self._waiting.setdefault(tile, [])
            waiting.append(stored)
            if len(waiting) < self._levels:
                return
            stored, *levels = self._waiting.pop(tile)
            partial = self._partials[tile] = Partial(self._of_tile(tile))
            # As in Blender's own packed images, floats have 32 bits.
            is_packed_float = self._folder and storing.is_float
            depth = file_formats.OPEN_EXR.depths[-1] if is_packed_float else storing.depth
            with partial.writing():
                partial.temporary.touch()
            content = functools.partial(
                image_file.content,
                stored,
                partial.temporary,
                depth,
                note="" if self._folder else shared_maps.to_text(self.parts, self._path),
                blocks=self._blocks(storing, levels, self._blocks_of(tile)) if storing.is_blocks else None,
                **self._how(storing),
            )
            self._written.append(self._queue.add(content, partial))
            if tile in self.chosen:
                self.chosen[tile] = self.chosen[tile].without_trial()
        else:
            self._texels = stored

    def _note_loss(self, texels: np.ndarray, stored: np.ndarray, storing: StorageSettings) -> None:
        """Note the angles that a tile loses. stored: its texels before they are rounded."""
        if storing.is_lossy:
            some = value_encoding.sample_blocks(texels) if storing.is_blocks else texels
            before, after = some.reshape(-1, 4), _kept(some, storing).reshape(-1, 4)
        elif not storing.is_float:
            before = value_encoding.sample_texels(texels)
            after = value_encoding.rounded(value_encoding.sample_texels(stored), storing.depth)
        else:
            return
        self._angles.append(value_encoding.angles_between(before, after))

    def _note_compressed(self, texels: np.ndarray, stored: np.ndarray, is_covered: np.ndarray) -> None:
        """Note what the compressor of a target engine leaves of the texels of a tile."""
        before, given, where = (value_encoding.sample_blocks(each, COMPRESSED) for each in (texels, stored, is_covered))
        if self.color_space == value_encoding.LINEAR:
            given = np.dstack([value_encoding.to_srgb(given[..., :3]), given[..., 3:]])
            before = np.dstack([value_encoding.to_srgb(before[..., :3]), before[..., 3:]])
        given = given if self.is_packed else np.dstack([given[..., :3], np.ones_like(given[..., 3:])])
        shown = block_encoding.compressed(given, self._compressor)
        off = np.abs(shown - before)[where][:, : 4 if self.is_packed else 3].max(axis=1)
        self._steps_off.append(off * np.float32(255.0))

    @property
    def compressed(self) -> dict[str, float | str]:
        """As Report.compressed has it; empty if no target engine compresses the map."""
        off = np.concatenate(self._steps_off) if self._steps_off else np.empty(0)
        if not len(off):
            return {}
        return {
            "format": formats.BY_NAME[self._compressor].label,
            "mean": float(off.mean()),
            "percentile_99": float(np.percentile(off, 99.0)),
        }

    def _blocks(
        self, storing: StorageSettings, levels: Sequence[np.ndarray] = (), first: np.ndarray | None = None
    ) -> Blocks:
        """How the file of a tile stores its texels, with those of its other levels. first: as Blocks has them."""
        is_any = storing.compression == Compression.AUTO
        block_format = formats.BC7 if is_any else formats.BY_NAME[storing.compression.lower()]
        if block_format is formats.BC6H and self._is_signed:
            block_format = formats.BC6H_SIGNED
        return Blocks(block_format, self._purpose, levels, has_map_in_alpha=self.is_packed, first=first)

    def _blocks_of(self, tile: int) -> np.ndarray | None:
        """The blocks of level 0 of a tile, if they were made when its format was chosen."""
        trial = self.chosen[tile].trial if tile in self.chosen else None
        return trial.blocks if trial else None

    @property
    def formats(self) -> dict[str, dict[str, Any]]:
        """What was chosen, as Report.formats has it."""
        return {
            str(self._of_tile(tile)): {**chosen.to_dict(), "bytes": self._sizes[tile]}
            for tile, chosen in sorted(self.chosen.items())
        }

    @property
    def paths(self) -> list[str]:
        """The absolute paths of the files, by tile. Links are not resolved."""
        return [] if self._folder else [str(self._of_tile(tile)) for tile in sorted(self._partials)]

    def _of_tile(self, tile: int) -> Path:
        return _absolute(udim.fill(self._path, tile))

    @property
    def loss(self) -> dict[str, float]:
        """Median and maximum of the error of normals, in degrees. Empty if they are stored as floats, but for blocks."""
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
        self._sizes = {tile: self._partials[tile].temporary.stat().st_size for tile in self.chosen}
        if not self.has_image:
            return
        if self._path and not file_formats.of(self._path).is_shown:
            self._texels = image_file.read(self._partials[udim.FIRST].temporary)
        _check_image(self.name)  # again, because the user may have painted on it
        if self._path and self.settings.sampling.udim:
            self._keep_other_tiles()

    def put_files(self) -> None:
        """Replace the files. Raises BakeError if that fails."""
        noting = journal.now()
        for partial in self._partials.values():
            if noting is None:
                partial.commit()
            else:
                noting.hand_over(partial)
        self._are_handed_over = noting is not None

    def show(self) -> bpy.types.Image:
        """Put the added texels into the image, and return it."""
        storing = self.settings.storing
        if self._texels is not None and self._path:  # Blender does not show the file
            image = datablocks.fill(
                self.name, self._texels, is_float=storing.is_float, pack=True, color_space=self.color_space
            )
        elif self._path:
            image = datablocks.show(self.name, self._path, pack=self._folder is not None, color_space=self.color_space)
        else:
            pack = storing.storage == Storage.PACK
            image = datablocks.fill(
                self.name, self._texels, is_float=storing.is_float, pack=pack, color_space=self.color_space
            )
        shared_maps.note(image, self.parts)
        return image

    def discard(self) -> None:
        """Remove temporary files. Can be called at any time, and more than once. A queue of several writers must be closed."""
        if self._is_own_queue:
            self._queue.close()
        for partial in self._partials.values() if not self._are_handed_over else ():
            partial.discard()
        if self._folder:
            self._folder.cleanup()

    def _keep(self, tile: int, texels: np.ndarray, is_kept: np.ndarray) -> None:
        """Put what is stored of a tile into `texels`. Raises BakeError if that of others changed during the bake."""
        before = shared_maps.stored(self.settings, tile)
        if before is not None and before.format == shared_maps.wanted(self.settings):
            np.copyto(texels, before.read(), where=is_kept[..., None])
        elif tile in self._kept_tiles:
            where = self._of_tile(tile) if self._path and not self._folder else self.name
            raise BakeError(
                f"{str(where)!r} was deleted or changed during the bake, and also has the map of other objects: bring it back, "
                "or bake all of them together."
            )

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


def commit_all(writers: Sequence[MapWriter]) -> list[bpy.types.Image]:
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


HIDDEN_MISSES = Fix.MISS_MASK.after(
    Sentence("Rays of some texels hit nothing, and files without alpha do not show which.", NOTE, "hidden_misses")
)
"""A warning."""


@journal.plain
@dataclass(frozen=True)
class Stored:
    """The result of `Outputs.commit`.

    Attributes:
        image: The normal map, or the first other map without one.
        images: Those of all maps.
        paths: The files of the normal map by tile, then those of each other map.
        tiles: UDIM numbers.
        mip_files, maps, attributes, loss, formats, compressed: As in Report.
        warnings: Sentences.
    """

    image: bpy.types.Image
    images: list[bpy.types.Image]
    paths: list[str]
    mip_files: dict[str, list[str]]
    tiles: list[int]
    maps: dict[str, dict]
    attributes: dict[str, str]
    loss: dict[str, float]
    formats: dict[str, dict[str, Any]]
    compressed: dict[str, dict[str, float | str]]
    warnings: list[str]


class Outputs:
    """Stores maps when `commit` is called. Before, no datablock or existing file changes. Use it in a `with` block."""

    def __init__(
        self,
        settings: Settings,
        baked: Sequence[Part] = (),
        kept: Mapping[str, Sequence[Part]] = MappingProxyType({}),
        kept_tiles: Mapping[str, Collection[int]] = MappingProxyType({}),
    ):
        """baked, kept, kept_tiles: as in MapWriter; what is kept by the name of the map."""
        self.settings = settings
        types, queue = stored_maps(settings.map), WriteQueue()
        self._queue, self._packed = queue, settings.map.packing.map_type.name if settings.map.packing else ""

        def writer(name: str, of_map: Settings, **more: Any) -> MapWriter:
            is_packed = name == self._packed
            shared = {"baked": baked, "kept": kept.get(name, ()), "kept_tiles": kept_tiles.get(name, ())}
            is_gray = types[name].is_gray and not is_packed
            levels = 1 + len(map_names.levels_of(settings, name)) if of_map.storing.is_blocks else 1
            kind = {"is_packed": is_packed, "is_gray": is_gray, "is_signed": types[name].is_signed, "levels": levels}
            purpose = _purpose(types[name], of_map)
            return MapWriter("", of_map, queue=queue, purpose=purpose, **kind, **shared, **more)

        self._writers = {
            name: writer(
                name,
                of_map,
                is_normal=types[name] is NORMAL,
                map_type=types[name],
                endings=map_names.open_endings(settings),
                color_space=value_encoding.color_space(types[name], of_map.storing),
            )
            for name, of_map in settings_by_map(settings).items()
        }
        self._levels = {
            (name, level): writer(name, map_names.of_level(of_map.settings, level), has_image=False)
            for name, of_map in self._writers.items()
            for level in map_names.level_files(settings, name)
        }
        """The writers of mip levels that have files of their own, by the name of the map and the number of the level."""
        self._first = map_names.first_map(settings.map)
        self._late: dict[str, dict[tuple[int, int], Map]] = {
            name: {}
            for name in settings.map.drawn_maps
            if value_encoding.needs_range(BY_NAME[name], self._settings_of(name).storing)
        }
        """The maps that are encoded when the range of all tiles is known, by tile and level. Others do not stay in memory."""
        self._unpacked: dict[tuple[int, int], dict[str, Map]] = {}
        """The maps to pack, by tile and level, and by name, if they are encoded late."""
        self._kept: dict[int, np.ndarray] = {}
        """The texels of each tile that stay as they are stored."""
        self._covered: dict[int, np.ndarray] = {}
        """The texels (height, width) bool of each tile that the low mesh has, if errors are measured on them."""
        self._vertices: list[VertexMaps] = []
        self._hides_misses = False
        """Whether a file has texels without a hit, and nothing that shows which."""
        self._cut_off: set[str] = set()
        """The maps with values that 16-bit floats do not hold."""
        self._empty = set(settings.map.drawn_maps)
        """The maps of which no texel had a value so far."""

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, *_) -> None:
        self._queue.close()  # first: nothing may be writing to files that are discarded
        with ExitStack() as discards:  # all of them run, even if one raises
            for writer in (*self._writers.values(), *self._levels.values()):
                discards.callback(writer.discard)

    def sample_onto(
        self, low: bpy.types.Object, uv_layer: str, *, is_own_base: bool, slots: Sequence[int] | None = None
    ) -> None:
        """Also store the maps that are added from now on in attributes of `low`, if the settings say so. See VertexMaps."""
        if self.settings.storing.vertex_domain != VertexDomain.NONE:
            self._vertices.append(VertexMaps(low, uv_layer, self.settings, is_own_base=is_own_base, slots=slots))

    def kept(self, tile: int, normals: Map) -> np.ndarray:
        """What programs read of a UDIM tile of the normal map, which is added afterwards: a new array, with the same alpha."""
        texels, state = normals
        writer = self._writers.get(NORMAL.name)
        chosen = writer.choose(tile, np.array(texels, np.float32), state == WRITTEN) if writer else None
        if chosen is None or chosen.trial is None:
            return kept(np.array(texels, np.float32), self.settings)
        shown = chosen.trial.texels.copy()
        shown[..., 3] = texels[..., 3]
        return shown

    def format_of(self, name: str, tile: int) -> str:
        """How the file of a tile stores a map that has images of its own, in words."""
        return auto_format.label_of(self._writers[name].way_of(tile))

    def add(
        self,
        tile: int,
        maps: dict[str, Map],
        levels: Sequence[dict[str, Map]] = (),
        is_kept: np.ndarray | None = None,
    ) -> None:
        """Add one UDIM tile of all maps, by name. Empty tiles are ignored: a triangle may touch a tile and cover no texel.

        levels: those of the maps that have mip levels, from level 1 on, if the settings write them. is_kept: as in
        MapWriter.add, of all maps, which then have no levels and are encoded without the range of their values.
        """
        texels, state = maps[NORMAL.name]
        if is_kept is not None:
            self._kept[tile] = is_kept
        if not state.any():
            return
        for vertices in self._vertices:
            vertices.add(tile, maps)
        if self.settings.storing.is_auto or any(targets.BY_NAME[each].compresses for each in self.settings.map.targets):
            self._covered[tile] = state == WRITTEN
        if NORMAL.name in self._writers:
            self._add(NORMAL.name, 0, tile, texels, is_kept)
        if MASK.name in self._writers:
            self._writers[MASK.name].add(tile, black_and_white(state == MISSED), is_kept)
        elif not self._writers[self._first].way_of(tile).storing.has_alpha:
            self._hides_misses |= bool((state == MISSED).any())
        self._empty -= {name for name in self._empty if (maps[name][0][..., 3] > 0.0).any()}
        self._add_others(tile, 0, maps)
        for level, level_maps in enumerate(levels, start=1):
            if NORMAL.name in self._writers:
                self._add(NORMAL.name, level, tile, level_maps[NORMAL.name][0])
            self._add_others(tile, level, level_maps)

    def _add_others(self, tile: int, level: int, maps: dict[str, Map]) -> None:
        """Add one level of the maps beside the normal map."""
        for name in (name for name in self.settings.map.drawn_maps if name in maps):
            if name in self._late:
                self._late[name][tile, level] = maps[name]
            else:
                self._encode(name, tile, level, maps[name], self._encoding(name, []))
        if self._packed:
            self._unpacked[tile, level] = {name: maps[name] for name in self.settings.map.packing.maps}
            if not self._late.keys() & self._unpacked[tile, level].keys():
                self._pack()

    def commit(self, labels: dict[Labeled, Sequence[str]], lows: Sequence[bpy.types.Object]) -> Stored:
        """Store all images and attributes or none. Raises BakeError.

        labels: the names of objects and of materials, whose numbers in the maps start at 1. lows: the low objects, as in the
        calls of `sample_onto`; they become users of the images.
        """
        encodings = {}
        for name in self.settings.map.drawn_maps:
            labeled = BY_NAME[name].labeled
            encodings[name] = self._encoding(name, labels[labeled] if labeled else [])
            for (tile, level), drawn in self._late.get(name, {}).items():
                self._encode(name, tile, level, drawn, encodings[name])
            if name in self._empty:
                encodings[name] |= {"empty": True}
        maps = {name: encodings[name] for name in self.settings.map.maps}
        if self._packed:
            self._pack()
            maps[self._packed] = {"channels": value_encoding.channels(self.settings.map.packing, encodings)}
        writers = [*self._writers.values(), *self._levels.values()]
        stored = dict(zip(self._writers, commit_all(writers), strict=True))
        for low in lows:
            datablocks.note_maps(low, stored.values())
        first = self._writers[self._first]
        warnings = sign(stored[self._first], labels[Labeled.OBJECTS])
        for image in stored.values():  # a bake may replace the files of maps that were baked before
            highs = dict.fromkeys(labels[Labeled.OBJECTS])
            datablocks.set_source_objects(image, highs, [low.name for low in lows])
        if self._hides_misses:
            warnings.append(HIDDEN_MISSES)
        warnings += [*self._of_blocks(), *self._over_limits()]
        if self._cut_off:
            titles = shorten_list(BY_NAME[name].title for name in self.settings.map.drawn_maps if name in self._cut_off)
            cause = f"16-bit floats cut off values beyond 65,504 of the {titles}."
            warnings.append(Fix.DEPTH.after(Sentence(cause, WRONG)))
        attributes = {}
        for vertices, low in zip(self._vertices, lows, strict=False):  # without attributes, there are only low objects
            names, more = vertices.store(low)
            attributes |= names
            warnings += more
        return Stored(
            image=stored[self._first],
            images=list(stored.values()),
            paths=[path for writer in self._writers.values() for path in writer.paths],
            tiles=list(first.tiles),
            mip_files={
                name.lower(): [path for level in levels for path in self._levels[name, level].paths]
                for name in self._writers
                if (levels := map_names.level_files(self.settings, name))
            },
            maps={name.lower(): {"image": stored[name].name} | how for name, how in maps.items()},
            attributes=attributes,
            loss=first.loss,
            formats={
                path: {"map": name.lower(), **how}
                for name, writer in self._writers.items()
                for path, how in writer.formats.items()
            },
            compressed={name.lower(): how for name, writer in self._writers.items() if (how := writer.compressed)},
            warnings=warnings,
        )

    def _of_blocks(self) -> list[Sentence]:
        """What blocks do not keep, and where their files do not show."""
        normals, texts = self._writers.get(NORMAL.name), []
        if normals is not None and normals.backwards:
            cause = (
                f"{normals.backwards:,} texels of the normal map have z below 0, which BC5 does not store: they show as "
                "facing up."
            )
            texts.append(Fix.BC7.after(Sentence(cause, LOOK, "rebuilt")))
        output = map_names.output_for(self.settings)
        if output and not file_formats.of(output).is_shown and _has_window():
            label = file_formats.of(output).label
            texts.append(Sentence(f"Blender does not show {label} files: its images are packed copies of them.", NOTE))
        return texts

    def _over_limits(self) -> Iterator[Sentence]:
        """A sentence for the maps whose formats do not keep their limits."""
        worst = {
            name: max(over, key=lambda chosen: chosen.percentile_99)
            for name, writer in self._writers.items()
            if (over := [chosen for chosen in writer.chosen.values() if not chosen.keeps_limit])
        }
        if not worst:
            return
        endings = map_names.open_endings(self.settings) or [PurePath(map_names.output_for(self.settings)).suffix]
        labels = shorten_list(file_formats.of(f"map{each}").label for each in endings)
        reached = shorten_list(
            f"{map_names.map_title(self.settings.map, name)} {chosen.percentile_99:.2g} {chosen.limit.unit}, not "
            f"{chosen.limit.most:g}"
            for name, chosen in worst.items()
        )
        yield Sentence(
            f"No format of {labels} files keeps the limits, so the most exact one is stored, with this at the 99th percentile: "
            f"{reached}. Choose a file of another format, or higher limits.",
            LOOK,
            "over_limit",
        )

    def _settings_of(self, name: str) -> Settings:
        """The settings of the image that stores a map: its own, or the packed one."""
        return (self._writers.get(name) or self._writers[self._packed]).settings

    def _encoding(self, name: str, labels: Sequence[str]) -> dict:
        """How to decode a map. labels: as in value_encoding.encoding."""
        tiles = [texels for texels, _ in self._late.get(name, {}).values()]
        how = value_encoding.encoding(BY_NAME[name], tiles, labels, self._settings_of(name).storing)
        is_tangent = name == VECTOR_DISPLACEMENT.name and self.settings.map.has_tangent_displacement
        return how | {"space": str(Space.TANGENT)} if is_tangent else how

    def _encode(self, name: str, tile: int, level: int, drawn: Map, how: dict) -> None:
        """Encode a level of a tile of a map in place, and add it to its writer if it has one of its own."""
        texels, _ = drawn
        if BY_NAME[name].is_color:
            datablocks.to_rec709(texels)
        if BY_NAME[name].kind is not Kind.NORMAL:
            value_encoding.encode(drawn, how)
        storing = self._settings_of(name).storing
        if (
            storing.is_half
            and BY_NAME[name].family.shows_materials
            and np.abs(texels[..., :3]).max() > value_encoding.MOST_HALF
        ):
            self._cut_off.add(name)
        if name in self._writers:
            self._add(name, level, tile, texels, self._kept.get(tile))

    def _add(self, name: str, level: int, tile: int, texels: np.ndarray, is_kept: np.ndarray | None = None) -> None:
        """Add a level of a map to its own file, or to that of the map."""
        writer = self._writers[name]
        if (name, level) in self._levels:
            self._levels[name, level].add(tile, texels, is_kept, way=writer.way_of(tile))
        else:
            writer.add(tile, texels, is_kept, level=level, is_covered=self._covered.get(tile))

    def _pack(self) -> None:
        """Add the encoded maps that wait to the packed image."""
        for (tile, level), maps in self._unpacked.items():
            packed = value_encoding.packed(self.settings.map.packing, maps)
            self._add(self._packed, level, tile, packed, self._kept.get(tile))
        self._unpacked.clear()


def _has_window() -> bool:
    """Whether somebody looks at images."""
    return not bpy.app.background


def _purpose(map_type: MapType, of_map: Settings) -> Purpose:
    """What the encoder of blocks keeps small."""
    if map_type.kind is Kind.NORMAL:
        return Purpose.NORMAL
    return Purpose.COLOR if value_encoding.color_space(map_type, of_map.storing) == SRGB else Purpose.DATA


def sign(image: bpy.types.Image, highs: Sequence[str]) -> list[str]:
    """Store the names of the high objects in `image`. Returns a warning if its map replaced one of other objects."""
    highs = list(dict.fromkeys(highs))
    before = replaced(image.name, highs)
    datablocks.set_source_objects(image, highs)
    if not before:
        return []
    text = f"The map of {shorten_list(map(repr, highs))} replaced a map of {before} in the image {image.name!r}."
    return rated([text], NOTE)
