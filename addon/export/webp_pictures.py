# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores the baked maps of a binary glTF in fewer bytes: as WebP, which glTF's extension EXT_texture_webp has textures show,
or in the smallest way within limits."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core import file_formats
from ..core.declarations.choices import Format, Storage
from ..core.map_types import AO, NORMAL
from ..core.report import Report
from ..core.settings import Settings
from ..output import auto_format, image_file, value_encoding
from ..output.auto_format import DEGREES, STEPS, Trial, Way
from . import basis_textures
from .binary_gltf import JPEG, KTX2, PNG, WEBP, Glb, shown_image
from .same_materials import KEYS, Maps, primitives_of
from .staging import Staged

NAMES = "export_webp", "export_ktx2", "quality", "lossy_normals", "storage", "format", "most_degrees", "most_steps"
"""The settings that this is by."""
LOSSLESS = 100
"""The quality without losses."""
LONGEST_SIDE = file_formats.WEBP.longest_side
_NORMAL = "normalTexture"
_COLORS = "baseColorTexture", "emissiveTexture"
_KINDS = {
    ending: kind
    for kind, each in (
        (PNG, file_formats.PNG),
        (WEBP, file_formats.WEBP),
        (JPEG, file_formats.JPEG),
        (KTX2, file_formats.KTX2),
    )
    for ending in each.endings
}
_ROUNDED = {DEGREES: 0.4, STEPS: 0.5}
"""By how much 8 bits are off at most."""


def changes(settings: Mapping[str, Any]) -> bool:
    """Whether maps are stored in another way than Blender's exporter has them. settings: those of NAMES."""
    return bool(settings.get("export_webp", False) or settings.get("export_ktx2", False)) or _is_auto(settings)


def _is_auto(settings: Mapping[str, Any]) -> bool:
    return settings.get("format") == Format.AUTO and settings.get("storage") == Storage.FILE


def store(file: Glb, staged: Sequence[Staged], settings: Mapping[str, Any], folder: Path) -> None:
    """Store the maps of staged objects in a file that Blender's exporter has written of them.

    Normal maps are without losses unless the settings say otherwise. With Format Auto, each image is the smallest that keeps
    the limits beside what the map lost before: PNG, JPEG, and WebP if the settings have it. KTX2 has UASTC where others have
    no losses, else ETC1S, and takes sides that are multiples of four. Other textures stay as they are,
    and so does a map with a side above LONGEST_SIDE, or with an alpha of 0 somewhere: WebP does not keep the colors there,
    which filtering shows at the borders of cutouts.

    Args:
        settings: Those of NAMES.
        folder: For temporary files.
    """
    if settings.get("export_ktx2", False):
        for number, kinds in _kinds(file, staged, settings).items():
            _store_ktx2(file, number, kinds, folder)
    elif _is_auto(settings):
        for number, limits in _limits(file, staged, settings).items():
            _store_smallest(file, number, limits, folder, with_webp=settings["export_webp"])
    else:
        for number, quality in _qualities(file, staged, settings).items():
            _store(file, number, quality, folder)
    for texture in file.tree.get("textures", ()):
        file.show_image(texture, shown_image(texture))
    file.pack_buffer()


def _baked(file: Glb, staged: Sequence[Staged]) -> Iterator[tuple[int, bool, Report]]:
    """Each image that holds a baked map, whether that is a normal map, and the report of its bake."""
    maps = Maps()
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
                    yield shown_image(file.tree["textures"][info["index"]]), key == _NORMAL, report


def _qualities(file: Glb, staged: Sequence[Staged], settings: Mapping[str, Any]) -> dict[int, int]:
    """The quality of each image that holds a baked map."""
    found: dict[int, int] = {}
    for number, is_normal, _ in _baked(file, staged):
        quality = LOSSLESS if is_normal and not settings["lossy_normals"] else settings["quality"]
        found[number] = max(found.get(number, 0), quality)
    return found


def _limits(file: Glb, staged: Sequence[Staged], settings: Mapping[str, Any]) -> dict[int, dict[str, float]]:
    """By how much each image that holds baked maps may be off, by the unit: the limit, less what the maps lost before."""
    most = {DEGREES: settings["most_degrees"], STEPS: settings["most_steps"]}
    found: dict[int, dict[str, float]] = {}
    for number, is_normal, report in _baked(file, staged):
        unit = DEGREES if is_normal else STEPS
        lost = [how["percentile_99"] for how in report.formats.values() if how["unit"] == unit]
        left = most[unit] - max(lost, default=_ROUNDED[unit])
        limits = found.setdefault(number, {})
        limits[unit] = min(left, limits.get(unit, left))
    return found


def _read(file: Glb, number: int, folder: Path) -> tuple[np.ndarray, bool] | None:
    """The texels of an image, and whether it has alpha; None for one that stays as it is."""
    image = file.tree["images"][number]
    if image["mimeType"] != PNG:
        return None
    path = folder / f"a map{file_formats.PNG.endings[0]}"
    path.write_bytes(file.view(image["bufferView"]))
    texels, has_alpha = image_file.read(path), image_file.format_of(path).has_alpha
    if max(texels.shape[:2]) > LONGEST_SIDE or (has_alpha and texels[..., 3].min() == 0.0):
        return None
    return texels, has_alpha


def _store(file: Glb, number: int, quality: int, folder: Path) -> None:
    """Store an image of a map as WebP, if that keeps its colors."""
    if (found := _read(file, number, folder)) is not None:
        texels, has_alpha = found
        target = folder / f"a map{file_formats.WEBP.endings[0]}"
        image_file.write(texels, target, 8, has_alpha=has_alpha, quality=quality)
        _replace(file, number, target)


def _store_smallest(file: Glb, number: int, limits: Mapping[str, float], folder: Path, *, with_webp: bool) -> None:
    """Store an image of maps in the smallest way within a limit, if that is smaller. An image of several units stays."""
    found = _read(file, number, folder)
    ((unit, most),) = limits.items() if len(limits) == 1 else (("", 0.0),)
    if found is None or most <= 0.0:
        return
    texels, has_alpha = found
    formats = [file_formats.PNG, *[file_formats.WEBP] * with_webp, *[file_formats.JPEG] * (not has_alpha)]
    endings = [each.endings[0] for each in formats]

    def write(way: Way) -> Path:
        path = (folder / "a map").with_suffix(Path(way.storing.output).suffix)
        is_normal = unit == DEGREES
        shown = value_encoding.in_steps(texels, way.step, is_normal=is_normal) if way.step > 1 else texels
        image_file.write(shown, path, 8, has_alpha=has_alpha, quality=way.storing.quality)
        return path

    def store(way: Way) -> Trial:
        path = write(way)
        return Trial(image_file.read(path), path.stat().st_size)

    settings = Settings(
        storage=Storage.FILE, output=f"map{endings[0]}", format=Format.AUTO, depth=8, most_degrees=most, most_steps=most
    )
    map_type = NORMAL if unit == DEGREES else AO
    chosen = auto_format.smallest(texels, _differ(texels), settings, map_type, store, endings=endings)
    before = file.tree["bufferViews"][file.tree["images"][number]["bufferView"]]["byteLength"]
    if chosen.keeps_limit and chosen.trial and chosen.trial.size < before:
        _replace(file, number, write(chosen.way))


@dataclass(frozen=True)
class _Kinds:
    """What an image of KTX2 holds."""

    quality: int
    is_normal: bool
    is_color: bool


def _kinds(file: Glb, staged: Sequence[Staged], settings: Mapping[str, Any]) -> dict[int, _Kinds]:
    """What each image that holds a baked map is for."""
    infos = [owner.get(key) for owner in _owners(file) for key in _COLORS]
    colors = {shown_image(file.tree["textures"][info["index"]]) for info in infos if isinstance(info, dict)}
    normals = {number for number, is_normal, _ in _baked(file, staged) if is_normal}
    qualities = _qualities(file, staged, settings)
    return {number: _Kinds(quality, number in normals, number in colors) for number, quality in qualities.items()}


def _owners(file: Glb) -> list[dict[str, Any]]:
    materials = file.tree.get("materials", ())
    return [owner for each in materials for owner in (each, each.get("pbrMetallicRoughness", {}))]


def _store_ktx2(file: Glb, number: int, kinds: _Kinds, folder: Path) -> None:
    """Store an image of a map as KTX2, if its sides allow that."""
    found = _read(file, number, folder)
    if found is None or any(side % basis_textures.MULTIPLE for side in found[0].shape[:2]):
        return
    texels = value_encoding.steps(found[0][::-1], 8)
    how = {"is_color": kinds.is_color, "is_normal": kinds.is_normal, "quality": kinds.quality}
    path = folder / f"a map{file_formats.KTX2.endings[0]}"
    path.write_bytes(basis_textures.encoded(texels, **how))
    _replace(file, number, path)


def _differ(texels: np.ndarray) -> np.ndarray:
    """The texels (height, width) bool that differ from one beside them: others may be background, which is stored well."""
    result = np.zeros(texels.shape[:2], bool)
    down, right = (texels[1:] != texels[:-1]).any(axis=2), (texels[:, 1:] != texels[:, :-1]).any(axis=2)
    result[1:] |= down
    result[:-1] |= down
    result[:, 1:] |= right
    result[:, :-1] |= right
    return result


def _replace(file: Glb, number: int, path: Path) -> None:
    """Make a file an image."""
    image = file.tree["images"][number]
    file.replace_view(image["bufferView"], path.read_bytes())
    image["mimeType"] = _KINDS[path.suffix]
