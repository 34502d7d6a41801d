# SPDX-License-Identifier: GPL-3.0-or-later
"""The image datablocks of maps: made, filled, packed, marked, and found again by the next bake; and their color spaces."""

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePath

import bpy
import numpy as np
from mathutils import Color

from ..core import udim
from ..core.map_types import MARK, ORIGIN
from ..core.naming import file_name
from ..core.udim import TOKEN
from . import journal

OTHER_NAMES = {
    "sRGB": ("sRGB Encoded Rec.709 (sRGB)", "sRGB - Texture", "Utility - sRGB - Texture", "srgb_texture", "srgb_tx"),
    "Linear Rec.709": ("Linear Rec.709 (sRGB)", "Utility - Linear - sRGB", "Linear", "lin_rec709", "lin_srgb"),
}
"""The names that other color configurations have for the color spaces of Blender's own."""


def assign_color_space(image: bpy.types.Image, color_space: str) -> None:
    """Give the image the color space with Blender's name `color_space`, or mark it as data for "".

    Only what differs is set, because Blender drops unsaved pixels when it changes. An image stays as it is if the color
    configuration does not have the space.
    """
    settings = image.colorspace_settings
    if not color_space:
        # Color configurations can have another name for "Non-Color", but not for its role.
        if not settings.is_data:
            settings.is_data = True
        return
    known = {item.identifier for item in settings.bl_rna.properties["name"].enum_items}
    name = next((name for name in (color_space, *OTHER_NAMES[color_space]) if name in known), None)
    if name is not None and settings.name != name:
        settings.name = name


def to_rec709(texels: np.ndarray) -> None:
    """Convert the colors of `texels` (height, width, 4) float32 in place from the working space to linear Rec.709."""
    columns = [Color(unit).from_scene_linear_to_rec709_linear() for unit in np.eye(3)]
    matrix = np.array(columns, np.float32)
    if not np.allclose(matrix, np.eye(3), atol=1e-5):
        texels[..., :3] = texels[..., :3] @ matrix


OPAQUE_BITS = {24, 96}
"""Image.depth, in bits per texel, of images without alpha. Their pixels have alpha; a file written from them does not."""
ITSELF = "imprint_itself"
"""A custom property of images of meshes that were baked onto themselves: these may be renamed later."""
UNPACKED = "imprint_unpacked"
"""A custom property of images whose map is only in memory: see `pack_unpacked`. Each map has another number."""
_numbers = itertools.count(1)


def get(name: str) -> bpy.types.Image | None:
    """The image of this name in the open file, or None. Images linked from a library do not count."""
    return bpy.data.images.get((name, None))


def origin(name: str) -> list[str]:
    """The names of the high objects of the map in the image `name`. Empty if unknown."""
    image = get(name)
    return list(filter(None, str(image.get(ORIGIN, "")).split("\n"))) if image is not None else []


def is_map(name: str) -> bool:
    """Whether the image `name` holds a map that Imprint has baked."""
    image = get(name)
    return image is not None and bool(image.get(ORIGIN) or image.get(MARK))


def is_of_itself(name: str) -> bool:
    """Whether the image `name` holds maps of meshes that were baked onto themselves alone."""
    image = get(name)
    return image is not None and bool(image.get(ITSELF))


@journal.recorded
def set_source_objects(image: bpy.types.Image, highs: Iterable[str], lows: Iterable[str] = ()) -> None:
    """Store the names that `origin` returns. lows: the low objects of the map, for `is_of_itself`."""
    names = list(highs)
    image[ORIGIN] = "\n".join(names)
    if names and set(names) <= set(lows):
        image[ITSELF] = True
    elif ITSELF in image:
        del image[ITSELF]


def fill(name: str, texels: np.ndarray, *, is_float: bool, pack: bool, color_space: str = "") -> bpy.types.Image:
    """The image `name`, made if missing, with `texels`, (height, width, 4) float32, in memory or packed.

    color_space: of the texels, as in `assign_color_space`.
    """
    height, width = texels.shape[:2]
    image = get(name)
    if image is None:
        image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=is_float, is_data=True)
    else:
        _regenerate(image, width, height, is_float)
        if pack and image.depth in OPAQUE_BITS:
            _give_alpha(image, color_space)
    keep_values(image, color_space)
    image.pixels.foreach_set(texels.reshape(-1))
    image.update()
    _keep(image)
    noting = journal.now()
    if pack or noting is not None:
        image.pack()
    else:
        image[UNPACKED] = next(_numbers)
    if noting is not None:
        noting.note(show_packed, name, noting.keep(image.packed_file.data), color_space=color_space)
    return image


@journal.replayed
def show_packed(name: str, path: str, *, color_space: str = "") -> bpy.types.Image:
    """The image `name`, made if missing, packed, with the content of the file at `path`, as `fill` has packed it."""
    image = get(name) or bpy.data.images.new(name, 1, 1, alpha=True, is_data=True)
    _forget_pixels(image)
    for source in ("GENERATED", "FILE"):  # a change of the source frees what is loaded, which would be shown, or packed
        image.source = source
    image.filepath_raw = path  # setting filepath would load the file
    image.pack()
    image.filepath_raw = image.packed_files[0].filepath = ""
    keep_values(image, color_space)
    _keep(image)
    return image


def refill(image: bpy.types.Image, texels: np.ndarray, *, is_float: bool) -> None:
    """Put back `texels`, as `fill` took them, into an image that has lost them."""
    height, width = texels.shape[:2]
    _regenerate(image, width, height, is_float)
    image.pixels.foreach_set(texels.reshape(-1))
    image.update()


@journal.replayed
def show(name: str, path: str, *, pack: bool = False, color_space: str = "") -> bpy.types.Image:
    """The image `name`, made if missing, with the file at `path`, or with a tile for each file of a path with TOKEN.

    Tiles of the image that have no file stay, empty. pack: pack the tiles, and clear the path of the files.
    color_space: as in `assign_color_space`.
    """
    image = get(name) or bpy.data.images.new(name, 1, 1, is_data=True)
    is_tiled = TOKEN in path
    numbers = {tile.number for tile in image.tiles} if is_tiled and image.source == "TILED" else set()
    _forget_pixels(image)
    image.source = "FILE"
    image.filepath = path
    if is_tiled:
        image.source = "TILED"  # looks for the files
    keep_values(image, color_space)
    image.reload()
    if pack:
        _pack_tiles(image)
    for number in sorted(numbers - {tile.number for tile in image.tiles}):
        image.tiles.new(tile_number=number)
    _keep(image)
    noting = journal.now()
    if noting is not None:
        noting.note(show, name, noting.keep_tiles(path) if pack else path, pack=pack, color_space=color_space)
    return image


def pack_unpacked() -> None:
    """Pack the images whose maps are only in memory: Blender saves no other pixels of them.

    Called before a file is saved. What was painted on such an image since is packed as well.
    """
    for image in filter(is_unpacked, bpy.data.images):
        image.pack()
        del image[UNPACKED]


def is_unpacked(image: bpy.types.Image) -> bool:
    """Whether the map of an image is only in memory."""
    return bool(image.get(UNPACKED) and image.source == "GENERATED" and image.is_dirty)


def _keep(image: bpy.types.Image) -> None:
    """Make Blender save the image also while nothing uses it, as most maps are until the artist connects them."""
    image.use_fake_user = True
    if UNPACKED in image:
        del image[UNPACKED]


def _pack_tiles(image: bpy.types.Image) -> None:
    image.pack()
    path = f"//{file_name(image.name)}.{TOKEN}{PurePath(image.filepath).suffix}"
    image.filepath_raw = path  # setting filepath would load the file
    for packed in image.packed_files:
        packed.filepath = udim.fill(path, packed.tile_number)


def tile_contents(image: bpy.types.Image) -> Iterator[tuple[int, bytes | Path]]:
    """The tiles of a tiled image: their number, and their packed bytes or their file. Empty tiles are left out."""
    packed = {part.tile_number: part.packed_file for part in image.packed_files}
    for tile in image.tiles:
        path = Path(bpy.path.abspath(udim.fill(image.filepath, tile.number), library=image.library)).absolute()
        if tile.number in packed:
            yield tile.number, packed[tile.number].data
        elif not packed and path.is_file():
            yield tile.number, path


def sources() -> Iterator[tuple[str, str]]:
    """The files that the open scene uses, except images in materials: absolute paths, and descriptions for messages."""
    noting = journal.now()
    path = bpy.data.filepath if noting is None else noting.file
    if path:
        yield path, "the open file"
    users = [(library, "a linked library") for library in bpy.data.libraries]
    users += [(cache, "a cache of the scene") for cache in bpy.data.cache_files]
    images = (texture.image for texture in bpy.data.textures if texture.type == "IMAGE")
    users += [(image, f"the image {image.name!r} of a texture") for image in filter(None, images)]
    for owner, title in users:
        if owner.filepath:  # relative to the file that the owner is linked from
            yield bpy.path.abspath(owner.filepath, library=owner.library), title


def pictures() -> Iterator[tuple[str, str]]:
    """The files of images of the open scene that Imprint did not bake, and that are not packed, as `sources` returns them."""
    for image in bpy.data.images:
        is_own = image.get(ORIGIN) or image.get(MARK)
        if image.filepath and not (is_own or image.packed_file) and image.source in {"FILE", "TILED", "SEQUENCE"}:
            yield bpy.path.abspath(image.filepath, library=image.library), f"the image {image.name!r}"


@journal.recorded
def note_maps(low: bpy.types.Object, images: Iterable[bpy.types.Image]) -> None:
    """Make the low object a user of its maps, so that they follow it into other files, also those that no material shows.

    Nothing happens to an object of a library, and without the property, which only the window's Blender registers.
    """
    if not low.is_editable or not hasattr(low, "imprint"):
        return
    maps = low.imprint.maps
    known = {item.image for item in maps}
    free = [item for item in maps if item.image is None]  # their images were deleted
    for image in dict.fromkeys(images):
        if image not in known:
            item = free.pop() if free else maps.add()
            # Blender matches the items of library overrides by their names.
            item.name, item.image = item.name or str(len(maps) - 1), image


def keep_values(image: bpy.types.Image, color_space: str = "") -> None:
    """Make Blender use the values of the image as they are: in their color space, and not multiplied with alpha.

    Call this before setting pixels: Blender drops unsaved pixels when one of these properties changes, so only those that
    differ are set.
    """
    assign_color_space(image, color_space)
    if image.alpha_mode != "CHANNEL_PACKED":
        image.alpha_mode = "CHANNEL_PACKED"
    if image.use_half_precision:  # the viewport would round the normals
        image.use_half_precision = False


def _forget_pixels(image: bpy.types.Image) -> None:
    if image.packed_file is not None:
        image.unpack(method="REMOVE")


def _regenerate(image: bpy.types.Image, width: int, height: int, is_float: bool) -> None:
    """Make the image a generated one of this size and kind, so that its pixels can be set."""
    _forget_pixels(image)
    if image.source != "GENERATED" or tuple(image.size) != (width, height) or image.is_float != is_float:
        image.source = "GENERATED"
        image.generated_width, image.generated_height = width, height
        image.use_generated_float = is_float


def _give_alpha(image: bpy.types.Image, color_space: str) -> None:
    """Give alpha to an image that was made without it, so that packing keeps it.

    Generating its pixels again does not help. Loading them from a file does, here a packed file of one texel.
    """
    width, height = image.size
    seed = bpy.data.images.new("Imprint seed", 1, 1, alpha=True, float_buffer=image.is_float, is_data=True)
    try:
        seed.pixels[0] = 0.0  # an untouched image is not packed
        seed.pack()
        image.source = "FILE"
        image.pack(data=seed.packed_file.data, data_len=seed.packed_file.size)
    finally:
        bpy.data.images.remove(seed)
    keep_values(image, color_space)  # before scaling, which sets pixels
    image.scale(width, height)
