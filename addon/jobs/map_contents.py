# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the images of maps still show what Imprint has written, also if other low objects of one image were baked since.

Images note that themselves, so that it goes with them into other files: which bake of each low object they show.
"""

import json
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from enum import StrEnum
from typing import NamedTuple

import bpy

from ..output import datablocks, journal, shared_maps
from ..scene import content_keys

MAP, CONTENT = "imprint_map", "imprint_content"
"""Custom properties of images of maps: what tells the last bakes of the low objects in it from others, and what Imprint has
written last."""

IN_MEMORY = "in memory"


class Written(StrEnum):
    """Why an image does not show what Imprint has written."""

    GONE = "gone"
    NO_FILE = "no file"
    EDITED = "edited"
    OTHER = "other"


class _Shown(NamedTuple):
    """A bake that an image shows.

    Attributes:
        name: Of the low object.
        material: Of the texture set; empty without one.
        layout: As in shared_maps.Part: by it, a low object is known that was renamed.
        key: Tells the map of this bake from all others.
    """

    name: str
    material: str
    layout: int
    key: str


def note(images: Iterable[bpy.types.Image], low: str, material: str = "") -> dict[str, str]:
    """Note what images show, as Imprint has just written it. Returns what tells this map from others, by the image's name.

    Nothing is noted in a shell, whose low objects keep no state, and whose records have the files.

    Args:
        low: The name of the low object that was baked, as shared_maps has it.
        material: As in shared_maps.Part.
    """
    if not hasattr(bpy.types.Object, "imprint"):
        return {}
    maps = {image: uuid.uuid4().hex[:12] for image in images}  # each its own: another map of the bake is none instead
    for image, key in maps.items():
        image[CONTENT] = _content(image)
        image[MAP] = json.dumps(list(_with(image, low, material, key)), separators=(",", ":"))
    noting = journal.now()
    if noting is not None:
        packed = {image.name: image[CONTENT] for image in maps if image.packed_files}
        hashes = {path: content_keys.files.of(temporary).sha256 for path, temporary in noting.files.items()}
        noting.note(note_as, {image.name: image[MAP] for image in maps}, packed, hashes)
    return {image.name: key for image, key in maps.items()}


def _with(image: bpy.types.Image, low: str, material: str, key: str) -> Iterator[_Shown]:
    """The bakes that an image shows after one more: those of others whose texels are still there, also if they were renamed."""
    others = {(part.name, part.material): part.layout for part in shared_maps.parts_of_image(image.name)}
    own = _Shown(low, material, others.pop((low, material), 0), key)
    layouts = set(others.values())
    for shown in _shown_by(image):
        is_renamed = shown.layout in layouts and shown[:3] != own[:3]
        if is_renamed or (shown.name, shown.material) in others:
            yield shown
    yield own


def _shown_by(image: bpy.types.Image) -> list[_Shown]:
    """The bakes that an image shows; none if another program has written the property."""
    try:
        return [_Shown(*item) for item in json.loads(image.get(MAP, "[]"))]
    except (ValueError, TypeError):
        return []


def baked_as(low: bpy.types.Object, maps: Mapping[str, str]) -> str:
    """The name that a low object had at the bake whose keys `note` has returned; empty if no image knows."""
    images = ((_image(low, name, key), key) for name, key in maps.items())
    shown = (each for image, key in images if _has(image, key) for each in _shown_by(image) if each.key == key)
    return next((each.name for each in shown), "")


def are_shown(low: bpy.types.Object, maps: Mapping[str, str]) -> tuple[bool, ...]:
    """Whether each image still has the texels of the bake whose keys `note` has returned, whatever was done to it since."""
    return tuple(_has(_image(low, name, key), key) for name, key in maps.items())


def names(low: bpy.types.Object, maps: Mapping[str, str]) -> set[str]:
    """The names that images have now which still show the bake whose keys `note` has returned."""
    images = ((_image(low, name, key), key) for name, key in maps.items())
    return {image.name for image, key in images if _has(image, key)}


def _has(image: bpy.types.Image | None, key: str) -> bool:
    """Whether an image shows a bake."""
    return image is not None and key in str(image.get(MAP, ""))  # not read: there may be hundreds


@journal.replayed
def note_as(maps: Mapping[str, str], packed: Mapping[str, str], hashes: Mapping[str, str]) -> None:
    """Note the same as another process has, where it is known without reading files.

    Args:
        maps: What is noted of bakes, by the images' names.
        packed: What packed images show.
        hashes: The SHA-256 of files, by their paths.
    """
    for path, sha256 in hashes.items():
        with suppress(OSError):
            content_keys.files.learn(path, sha256)
    for name, shown in maps.items():
        image = datablocks.get(name)
        image[MAP], image[CONTENT] = shown, packed.get(name) or _content(image)


def look(low: bpy.types.Object | None, maps: Mapping[str, str]) -> dict[str, str]:
    """What `note` has returned, for the maps that are as they were; for the others, why not, as in Written. low: their user."""
    return {name: _written(_image(low, name, key), key) for name, key in maps.items()}


def _image(low: bpy.types.Object | None, name: str, key: str) -> bpy.types.Image | None:
    """The image of a map, also if it was renamed, or came from another file."""
    own = [item.image for item in low.imprint.maps] if low is not None and hasattr(low, "imprint") else []
    named = datablocks.get(name)
    return next((image for image in (named, *own) if _has(image, key)), named)


def _written(image: bpy.types.Image | None, key: str) -> str:
    if not _has(image, key):
        return Written.OTHER if image is not None and image.get(MAP) else Written.GONE
    now = _content(image)
    if content_keys.GONE in now:
        return Written.NO_FILE
    return key if image.get(CONTENT) == now else Written.EDITED


def is_as_written(image: bpy.types.Image) -> bool:
    """Whether an image, and so its file, still shows what Imprint has written last."""
    return bool(image.get(CONTENT)) and image[CONTENT] == _content(image)


def pack_unpacked() -> None:
    """As datablocks.pack_unpacked, of maps that then still are as Imprint has written them."""
    kept = [image for image in bpy.data.images if datablocks.is_unpacked(image) and is_as_written(image)]
    datablocks.pack_unpacked()
    for image in kept:
        image[CONTENT] = _content(image)


def _content(image: bpy.types.Image) -> str:
    """What an image shows. Strokes on one that is only in memory do not count: reading its pixels takes too long."""
    in_memory = [IN_MEMORY, f"{image.size[0]}x{image.size[1]}"]
    stored = in_memory if image.source == "GENERATED" else content_keys.of_stored(image)
    return " ".join([*stored, image.colorspace_settings.name])
