# SPDX-License-Identifier: GPL-3.0-or-later
"""The materials of a .glb that gets maps: one in place of all, or each with the maps that were baked and all else as it was."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np

from ..core.map_types import AO, BASE_COLOR, EMISSION, METALLIC, NORMAL, ROUGHNESS, WIDENED_ROUGHNESS
from ..core.report import Report
from ..output import datablocks
from . import binary_gltf, map_pictures
from .binary_gltf import Glb
from .staging import Staged

OPACITY = {"OPAQUE": 0, "MASK": 1, "BLEND": 2}
"""glTF's alpha modes. One material has the last of those that it replaces."""
_OLD_COLORS = "_COLOR_0"
"""What vertex colors become that the base color map has already: glTF multiplies both."""
KEYS = {
    AO.name: ("occlusionTexture",),
    NORMAL.name: ("normalTexture",),
    EMISSION.name: ("emissiveTexture", "emissiveFactor"),
    BASE_COLOR.name: ("baseColorTexture", "baseColorFactor"),
    **dict.fromkeys(
        (ROUGHNESS.name, WIDENED_ROUGHNESS.name, METALLIC.name),
        ("metallicRoughnessTexture", "metallicFactor", "roughnessFactor"),
    ),
}
"""The keys of a material that hold a map."""
_FACTORS = {"metallicFactor": {METALLIC.name}, "roughnessFactor": {ROUGHNESS.name, WIDENED_ROUGHNESS.name}}
"""The factors of the channels of one texture, by the maps in them."""
_STRENGTH = "KHR_materials_emissive_strength"
VARIANTS = "KHR_materials_variants"


def _lost(old: dict, baked: set[str]) -> list[str]:
    """What a material loses with textures that baked maps take the place of, in sentences."""
    surface, lost = old.get("pbrMetallicRoughness", {}), []
    shares = [not baked.isdisjoint(names) for names in _FACTORS.values()]
    if "metallicRoughnessTexture" in surface and any(shares) and not all(shares):
        lost.append("roughness" if shares[0] else "metallic")
    if "baseColorTexture" in surface and old.get("alphaMode", "OPAQUE") != "OPAQUE" and BASE_COLOR.name in baked:
        lost += [] if "ALPHA" in baked else ["alpha"]
    return [
        f"Material {old.get('name', '')!r} loses the texture of its {what}, which is in one image with what was baked: bake "
        f"the {what} map as well."
        for what in lost
    ]


FLAT = 1.5 / 255.0
"""By how much the texels of a normal map without detail may differ from straight up: by rounding, and by dither."""


class Maps:
    """Which maps bakes have. Images are looked at once."""

    def __init__(self):
        self._flat: dict[str, bool] = {}

    def of(self, report: Report) -> set[str]:
        """The names of the maps of a bake that have something to show: a normal map may be flat."""
        parts = [part for how in report.maps.values() for part in (how, *how.get("channels", {}).values())]
        names = {name.upper() for name in report.maps} | {part["map"].upper() for part in parts if part.get("map")}
        if not report.settings["normal"]:
            return names
        if report.image not in self._flat:
            self._flat[report.image] = _is_flat(report)
        return names if self._flat[report.image] else names | {NORMAL.name}


def primitives_of(tree: Mapping[str, Any], one: Staged) -> list[dict]:
    """The primitives of a staged object in a file that Blender's exporter has written of it."""
    node = next(node for node in tree["nodes"] if node.get("name") == one.name and "mesh" in node)
    return tree["meshes"][node["mesh"]]["primitives"]


def _is_flat(report: Report) -> bool:
    """Whether the normal map of a bake has no detail."""
    image = datablocks.get(report.image)
    texels = map_pictures.pixels(image) if image is not None else np.zeros((1, 4), np.float32)
    texels = texels[texels[..., 3] > 0.0]
    up = [{"+Z": 1.0, "-Z": 0.0}.get(report.settings[name], 0.5) for name in ("red", "green", "blue")]
    return not len(texels) or bool(np.abs(texels[:, :3] - up).max() <= FLAT)


class Materials:
    """Takes materials over from the file that Blender has written, each once. notes: warnings.

    replaced: the materials of the file that `made` ones may replace.
    """

    def __init__(self, file: Glb, made: Glb, replaced: Sequence[dict], maps: Maps):
        self.file, self.made, self.replaced, self.maps = file, made, replaced, maps
        self.notes: list[str] = []
        self._images: dict[bytes, int] = {}
        self._added: list[int] = []

    def put(self, primitive: dict, one: Staged, slot: int, uv_set: int) -> None:
        """Give a primitive the material of a slot of a staged object."""
        texture = next((number for number, (each, _) in enumerate(one.textures) if each == slot), None)
        report = one.baked.report_of(slot)
        number = (
            None if texture is None or report is None else primitives_of(self.made.tree, one)[texture].get("material")
        )
        if number is None:
            return
        baked = self.maps.of(report)
        material = self.made.tree["materials"][number]
        if NORMAL.name not in baked:
            material = {key: value for key, value in material.items() if key not in KEYS[NORMAL.name]}
        taken = self._taken(material, uv_set) | {"name": one.baked.name_of(slot)}
        if report.settings.get("one_material"):
            material = self._with_surface(taken, has_alpha="ALPHA" in baked)
            if primitive.get("extensions", {}).pop(VARIANTS, None):
                self.notes.append(f"{one.baked.name!r} has one material, and no variants of it any more.")
            if not primitive.get("extensions", True):
                del primitive["extensions"]
        else:
            old = primitive.get("material")
            before = {} if old is None else self.file.tree["materials"][old]
            material = self._merged(before, taken, baked)
            self.notes += _lost(before, baked)
        primitive["material"] = self._number(material)
        if BASE_COLOR.name in baked and "COLOR_0" in primitive["attributes"]:
            is_opaque = "ALPHA" in baked or material.get("alphaMode", "OPAQUE") == "OPAQUE"
            self._whiten(primitive["attributes"], has_alpha=not is_opaque)

    def _whiten(self, attributes: dict[str, int], *, has_alpha: bool) -> None:
        """Put vertex colors aside. has_alpha: whether their alpha still counts, and stays on white."""
        number = attributes[_OLD_COLORS] = attributes.pop("COLOR_0")
        if not has_alpha or self.file.tree["accessors"][number]["type"] != "VEC4":
            return
        values = self.file.whole(number)
        is_float = values.dtype.kind == "f"
        white = 1.0 if is_float else np.iinfo(values.dtype).max
        if (values[:, 3] < white).any():
            values[:, :3] = white
            attributes["COLOR_0"] = self.file.add_accessor(values, **({} if is_float else {"normalized": True}))

    def _taken(self, material: dict, uv_set: int) -> dict[str, Any]:
        """A material whose textures are in the file."""
        result = deepcopy(material)
        for info in binary_gltf.textures_of(result):
            info["index"] = self._texture(info["index"])
            info["texCoord"] = uv_set
        names = self.file.tree.setdefault("extensionsUsed", [])
        names += [name for name in result.get("extensions", ()) if name not in names]
        if not names:
            del self.file.tree["extensionsUsed"]
        return result

    def _texture(self, number: int) -> int:
        """The number in the file of a texture of the other one."""
        made = self.made.tree
        data = self.made.image(number)
        if data not in self._images:
            texture = made["textures"][number]
            image = made["images"][binary_gltf.shown_image(texture)]
            kept = {key: image[key] for key in ("name", "mimeType") if key in image}
            entry = {"source": self.file.add("images", kept | {"bufferView": self.file.add_view(data)})}
            self.file.show_image(entry, entry["source"])
            if "sampler" in texture:
                entry["sampler"] = self.file.add("samplers", deepcopy(made["samplers"][texture["sampler"]]))
            self._images[data] = self.file.add("textures", entry)
        return self._images[data]

    def _with_surface(self, material: dict, *, has_alpha: bool) -> dict[str, Any]:
        """One material with the alpha mode and the sides of those that it replaces."""
        result = {
            key: value for key, value in material.items() if key not in ("alphaMode", "alphaCutoff", "doubleSided")
        }
        mode = max((old.get("alphaMode", "OPAQUE") for old in self.replaced), key=OPACITY.get, default="OPAQUE")
        if has_alpha and OPACITY[mode]:
            result["alphaMode"] = mode
        elif OPACITY[mode]:
            self.notes.append(
                f"Material {material['name']!r} is opaque, and one before it was not: bake the alpha map as well."
            )
        if any(old.get("doubleSided") for old in self.replaced):
            result["doubleSided"] = True
        return result

    def _merged(self, old: dict, made: dict, baked: set[str]) -> dict[str, Any]:
        """A material of the file with the baked maps, and all else as it was."""
        result = deepcopy(old)
        keys = {key for name in baked for key in KEYS.get(name, ())}
        surfaces = result.setdefault("pbrMetallicRoughness", {}), made.get("pbrMetallicRoughness", {})
        for owner, source in ((result, made), surfaces):
            for key in keys & {*owner, *source}:
                if key in source:
                    owner[key] = source[key]
                else:
                    owner.pop(key, None)
        before = old.get("pbrMetallicRoughness", {})
        for factor, names in _FACTORS.items():
            if baked.isdisjoint(names):  # the texture is white there
                surfaces[0].pop(factor, None)
                surfaces[0].update({factor: before[factor]} if factor in before else {})
        opacity = before.get("baseColorFactor", (1.0,))[-1]
        if BASE_COLOR.name in baked and "ALPHA" not in baked and opacity != 1.0:
            surfaces[0]["baseColorFactor"] = [1.0, 1.0, 1.0, opacity]
        if not result["pbrMetallicRoughness"]:
            del result["pbrMetallicRoughness"]
        if EMISSION.name in baked:
            extensions = {**result.get("extensions", {})}
            extensions.pop(_STRENGTH, None)
            extensions |= {name: how for name, how in made.get("extensions", {}).items() if name == _STRENGTH}
            result |= {"extensions": extensions}
        return {key: value for key, value in result.items() if key != "extensions" or value}

    def _number(self, material: dict) -> int:
        """The number of a material in the file, which is added if it is not there yet."""
        tree = self.file.tree
        known = (number for number in self._added if tree["materials"][number] == material)
        number = next(known, None)
        if number is None:
            number = self.file.add("materials", material)
            self._added.append(number)
        return number
