# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the images of maps still show what Imprint has written, also if other low objects of one image were baked since.

Images note that themselves, so that it goes with them into other files.
"""

import uuid
from collections.abc import Iterable, Mapping
from contextlib import suppress
from enum import StrEnum

import bpy

from ..output import datablocks, journal
from ..scene import content_keys

MAP, CONTENT = "imprint_map", "imprint_content"
"""Custom properties of images of maps: what tells the map from others, whatever the image is called, and what Imprint has
written last."""

IN_MEMORY = "in memory"


class Written(StrEnum):
    """Why an image does not show what Imprint has written."""

    GONE = "gone"
    NO_FILE = "no file"
    EDITED = "edited"


def note(images: Iterable[bpy.types.Image]) -> dict[str, str]:
    """Note what images show, as Imprint has just written it. Returns what tells their maps from others, by name.

    Nothing is noted in a shell, whose low objects keep no state, and whose records have the files.
    """
    if not hasattr(bpy.types.Object, "imprint"):
        return {}
    maps, images = {}, list(images)
    for image in images:
        image[CONTENT] = _content(image)
        if not image.get(MAP):
            image[MAP] = uuid.uuid4().hex[:12]
        maps[image.name] = image[MAP]
    noting = journal.now()
    if noting is not None:
        packed = {image.name: image[CONTENT] for image in images if image.packed_files}
        hashes = {path: content_keys.files.of(temporary).sha256 for path, temporary in noting.files.items()}
        noting.note(note_as, maps, packed, hashes)
    return maps


@journal.replayed
def note_as(maps: Mapping[str, str], packed: Mapping[str, str], hashes: Mapping[str, str]) -> None:
    """Note the same as another process has, where it is known without reading files.

    Args:
        maps: As `note` has returned them there.
        packed: What packed images show.
        hashes: The SHA-256 of files, by their paths.
    """
    for path, sha256 in hashes.items():
        with suppress(OSError):
            content_keys.files.learn(path, sha256)
    for name, key in maps.items():
        image = datablocks.get(name)
        image[MAP], image[CONTENT] = key, packed.get(name) or _content(image)


def look(low: bpy.types.Object | None, maps: Mapping[str, str]) -> dict[str, str]:
    """What `note` has returned, for the maps that are as they were; for the others, why not, as in Written. low: their user."""
    return {name: _written(_image(low, name, key), key) for name, key in maps.items()}


def _image(low: bpy.types.Object | None, name: str, key: str) -> bpy.types.Image | None:
    """The image of a map, also if it was renamed, or came from another file."""
    own = [item.image for item in low.imprint.maps] if low is not None and hasattr(low, "imprint") else []
    images = [image for image in (datablocks.get(name), *own) if image is not None]
    return next((image for image in images if image.get(MAP) == key), next(iter(images[:1]), None))


def _written(image: bpy.types.Image | None, key: str) -> str:
    if image is None or image.get(MAP) != key:
        return Written.GONE
    now = _content(image)
    if content_keys.GONE in now:
        return Written.NO_FILE
    return key if image.get(CONTENT) == now else Written.EDITED


def pack_unpacked() -> None:
    """As datablocks.pack_unpacked, of maps that then still are as Imprint has written them."""
    kept = [image for image in bpy.data.images if datablocks.is_unpacked(image) and image.get(CONTENT)]
    kept = [image for image in kept if image[CONTENT] == _content(image)]
    datablocks.pack_unpacked()
    note(kept)


def _content(image: bpy.types.Image) -> str:
    """What an image shows. Strokes on one that is only in memory do not count: reading its pixels takes too long."""
    return IN_MEMORY if image.source == "GENERATED" else " ".join(content_keys.of_stored(image))
