# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores the baked maps of a binary glTF as WebP, which glTF's extension EXT_texture_webp has textures show."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..core import file_formats
from ..output import image_file
from .binary_gltf import PNG, WEBP, Glb, shown_image
from .same_materials import KEYS, Maps, primitives_of
from .staging import Staged

NAMES = "export_webp", "quality", "lossy_normals"
"""The settings that this is by."""
LOSSLESS = 100
"""The quality without losses."""
LONGEST_SIDE = file_formats.WEBP.longest_side
_NORMAL = "normalTexture"


def store(file: Glb, staged: Sequence[Staged], settings: Mapping[str, Any], folder: Path) -> None:
    """Store the maps of staged objects as WebP in a file that Blender's exporter has written of them.

    Normal maps are without losses unless the settings say otherwise. Other textures stay as they are, and so does a map
    with a side above LONGEST_SIDE, or with an alpha of 0 somewhere: WebP does not keep the colors there, which filtering shows
    at the borders of cutouts.

    Args:
        settings: Those of NAMES.
        folder: For temporary files.
    """
    for number, quality in _qualities(file, staged, settings).items():
        _store(file, number, quality, folder)
    images = file.tree.get("images", ())
    for texture in file.tree.get("textures", ()):
        if images[shown_image(texture)]["mimeType"] == WEBP:
            file.show_webp(texture, shown_image(texture))
    file.pack_buffer()


def _qualities(file: Glb, staged: Sequence[Staged], settings: Mapping[str, Any]) -> dict[int, int]:
    """The quality of each image that holds a baked map."""
    maps, found = Maps(), {}
    for one in staged:
        for primitive, (slot, _) in zip(primitives_of(file.tree, one), one.textures, strict=True):
            report = one.baked.report_of(slot)
            if report is None or "material" not in primitive:
                continue
            keys = {key for name in maps.of(report) for key in KEYS.get(name, ())} | {_NORMAL}
            material = file.tree["materials"][primitive["material"]]
            owners = material, material.get("pbrMetallicRoughness", {})
            for key, info in ((key, owner[key]) for owner in owners for key in keys & owner.keys()):
                if isinstance(info, dict):  # factors are numbers
                    is_exact = key == _NORMAL and not settings["lossy_normals"]
                    quality = LOSSLESS if is_exact else settings["quality"]
                    number = shown_image(file.tree["textures"][info["index"]])
                    found[number] = max(found.get(number, 0), quality)
    return found


def _store(file: Glb, number: int, quality: int, folder: Path) -> None:
    """Store an image of a map as WebP, if that keeps its colors."""
    image = file.tree["images"][number]
    path = folder / f"a map{file_formats.PNG.endings[0]}"
    path.write_bytes(file.view(image["bufferView"]))
    if image["mimeType"] != PNG:
        return
    texels, has_alpha = image_file.read(path), image_file.format_of(path).has_alpha
    if max(texels.shape[:2]) > LONGEST_SIDE or (has_alpha and texels[..., 3].min() == 0.0):
        return
    target = path.with_suffix(file_formats.WEBP.endings[0])
    image_file.write(texels, target, 8, has_alpha=has_alpha, quality=quality)
    file.replace_view(image["bufferView"], target.read_bytes())
    image["mimeType"] = WEBP
