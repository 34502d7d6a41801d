# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels into an image datablock, and into a file."""

from dataclasses import replace
from pathlib import Path, PurePath

import bpy
import numpy as np

from .errors import BakeError
from .files import check_writable, replacing
from .settings import FORMATS, Settings

MISSED = "missed"
"""What the name of a mask of misses ends in."""

OPAQUE_BITS = {24, 96}
"""Image.depth, bits a texel, of images without alpha: their pixels hold it, but a file written from them does not."""

PNG_END = b"IEND\xae\x42\x60\x82"
"""The last bytes of every whole PNG file."""


def name_for(low_name: str, settings: Settings) -> str:
    """The name of the image datablock; "{low}" in it stands for the low object's."""
    return settings.image.replace("{low}", low_name) or f"{low_name}_normal"


def check(low_name: str, settings: Settings) -> None:
    """Raise BakeError if the image cannot be written to, before anything is baked."""
    image = bpy.data.images.get((name_for(low_name, settings), None))
    if image is not None and (
        image.source not in {"GENERATED", "FILE"} or image.type not in {"IMAGE", "UV_TEST"} or image.is_multiview
    ):
        raise BakeError(f"The image {image.name!r} is no single still picture: choose another name for the map.")
    if settings.storage == "FILE":
        if settings.output.startswith("//") and not bpy.data.filepath:
            raise BakeError(f"{settings.output!r} is relative to a .blend file that was never saved: save it first.")
        check_writable(_path(settings))
        if settings.mask:
            check_writable(_path(beside(settings, MISSED)))


def store(texels: np.ndarray, low_name: str, settings: Settings) -> bpy.types.Image:
    """Put `texels`, (height, width, 4) float32 with row 0 at v = 0, where the settings want them.

    The image is Non-Color and channel-packed. A file is written beside its place and then moved there, so that an old
    one is never half overwritten. Raises BakeError if the file cannot be written; then no image has changed.
    """
    name = name_for(low_name, settings)
    image = bpy.data.images.get((name, None))
    if settings.storage == "FILE":
        _write_file(texels, settings)
        image = image or bpy.data.images.new(name, 1, 1, is_data=True)
        _forget_pixels(image)
        image.filepath = settings.output
        image.source = "FILE"
        _mark_as_data(image)
        image.reload()
    else:
        is_float = settings.depth > 8
        if image is None:
            height, width = texels.shape[:2]
            image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=is_float, is_data=True)
        else:
            _regenerate(image, texels.shape, is_float)
            if settings.storage == "PACK" and image.depth in OPAQUE_BITS:
                _give_alpha(image)
        _mark_as_data(image)
        image.pixels.foreach_set(texels.reshape(-1))
        image.update()
        if settings.storage == "PACK":
            image.pack()
    return image


class Writer:
    """A map on its way into an image datablock, and a file. Nothing of an artist's changes before commit."""

    def __init__(self, low_name: str, settings: Settings):
        self.low_name, self.settings = low_name, settings
        self._texels: dict[int, np.ndarray] = {}

    def add(self, tile: int, texels: np.ndarray) -> None:
        """Take one UDIM tile, (height, width, 4) float32 with row 0 at v = 0."""
        self._texels[tile] = texels

    def commit(self) -> bpy.types.Image:
        """Put what was added where the settings want it. Raises BakeError if that cannot be done."""
        return store(self._texels[1001], self.low_name, self.settings)


def beside(settings: Settings, name: str, depth: int | None = None) -> Settings:
    """The settings of another map beside that of `settings`, whose image is named: `name` is what its name ends in.

    depth: bits a channel; None for the fewest that the format has.
    """
    path = PurePath(settings.output)
    is_file = settings.storage == "FILE"
    return replace(
        settings,
        image=f"{settings.image}_{name}",
        output=str(path.with_stem(f"{path.stem}_{name}")) if is_file else "",
        depth=depth or (FORMATS[path.suffix.lower()][1][0] if is_file else 8),
    )


def black_and_white(where: np.ndarray) -> np.ndarray:
    """Texels (height, width, 4) float32 that are white where `where` (height, width) is true."""
    texels = np.ones((*where.shape, 4), np.float32)
    texels[..., :3] = where[..., None]
    return texels


def _mark_as_data(image: bpy.types.Image) -> None:
    # Before the pixels are set, since Blender drops those that no file holds when one of these changes; and not when
    # nothing changes. By role, since a colour configuration may call it otherwise than "Non-Color".
    if not image.colorspace_settings.is_data:
        image.colorspace_settings.is_data = True
    if image.alpha_mode != "CHANNEL_PACKED":
        image.alpha_mode = "CHANNEL_PACKED"
    if image.use_half_precision:  # the viewport would round the normals
        image.use_half_precision = False


def _forget_pixels(image: bpy.types.Image) -> None:
    if image.packed_file is not None:
        image.unpack(method="REMOVE")


def _regenerate(image: bpy.types.Image, shape: tuple[int, ...], is_float: bool) -> None:
    """Make an existing image one of this size and kind whose pixels are free to be set."""
    height, width = shape[:2]
    _forget_pixels(image)
    if image.source != "GENERATED" or tuple(image.size) != (width, height) or image.is_float != is_float:
        image.source = "GENERATED"
        image.generated_width, image.generated_height = width, height
        image.use_generated_float = is_float


def _give_alpha(image: bpy.types.Image) -> None:
    """Let an image that was made without alpha pack it.

    Generating its pixels anew does not help, only reading them from a file does: one that is packed and has one texel.
    """
    width, height = image.size
    seed = bpy.data.images.new("Imprint seed", 1, 1, alpha=True, float_buffer=image.is_float, is_data=True)
    try:
        seed.pixels[0] = 0.0  # an image that nobody has touched is not packed
        seed.pack()
        image.source = "FILE"
        image.pack(data=seed.packed_file.data, data_len=seed.packed_file.size)
    finally:
        bpy.data.images.remove(seed)
    _mark_as_data(image)  # before it is scaled, see there
    image.scale(width, height)


def _path(settings: Settings) -> Path:
    return Path(bpy.path.abspath(settings.output)).absolute()


def _write_file(texels: np.ndarray, settings: Settings) -> None:
    path = _path(settings)
    height, width = texels.shape[:2]
    # A scene of its own for Blender's image writer: the artist's output settings stay as they are.
    scene = bpy.data.scenes.new("Imprint output")
    image = bpy.data.images.new(
        "Imprint output", width, height, alpha=True, float_buffer=settings.depth > 8, is_data=True
    )
    try:
        _mark_as_data(image)
        image.pixels.foreach_set(texels.reshape(-1))
        output = scene.render.image_settings
        output.file_format = FORMATS[path.suffix.lower()][0]
        output.color_mode, output.color_depth = "RGBA", str(settings.depth)
        with replacing(path) as partial:
            image.save_render(str(partial), scene=scene)
            if output.file_format == "PNG" and not _is_whole_png(partial):
                raise RuntimeError("the disk took only a part of it")  # which Blender's PNG writer does not notice
    finally:
        bpy.data.images.remove(image)
        bpy.data.scenes.remove(scene)


def _is_whole_png(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - len(PNG_END)))
        return file.read() == PNG_END
