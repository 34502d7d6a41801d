# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers the materials of high objects, and reads each of them once."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from enum import IntEnum

import bpy

from ...core.map_types import BASE_COLOR, MARK
from ...core.material_feeds import AttributeFeed, BumpFeed, DetailFeed, HighMaterial, ImageFeed, NormalMapFeed
from ..materials.material_reading import NORMAL, read_materials
from ..textures import ImageTextures


class Bare(IntEnum):
    """Faces without a material. Their values are keys that no material has."""

    PLAIN = 0
    COLORED = -1
    """With vertex colors."""


Shown = bpy.types.Material | Bare
"""What a slot shows."""


class MaterialNumbers:
    """The materials by their numbers, which count from 1.

    sockets: those to read, as read_materials takes them. low: the low object; what the bake leaves in its materials is no
    detail of a high object that shows the same material. before: those of an earlier reading, which keep their numbers.
    """

    def __init__(
        self,
        images: ImageTextures,
        low: bpy.types.Object,
        *,
        sockets: Collection[str],
        before: Sequence[HighMaterial] = (),
    ):
        self.images, self.sockets = images, sockets
        self._of_low = {slot.material for slot in low.material_slots if slot.material}
        self._found: dict[int, HighMaterial] = {material.key: material for material in before}

    @property
    def materials(self) -> list[HighMaterial]:
        """In the order of their numbers."""
        return list(self._found.values())

    def of_slots(self, obj: bpy.types.Object, data: bpy.types.Mesh) -> list[Shown]:
        """What each slot of `obj` shows on its mesh `data`; at least one."""
        # Scans often have vertex colors and no material.
        bare = Bare.COLORED if data.attributes.get(data.attributes.default_color_name or "") else Bare.PLAIN
        return [slot.material.original if slot.material else bare for slot in obj.material_slots] or [bare]

    def read(self, material: Shown) -> HighMaterial:
        """What feeds a material."""
        key = _key(material)
        if key not in self._found:
            is_bare = isinstance(material, Bare)
            found = read_materials([None if is_bare else material], self.images, self.sockets)[0]
            if material is Bare.COLORED:
                found = replace(found, feeds=found.feeds | {BASE_COLOR.socket: AttributeFeed("")})
            if material in self._of_low:
                is_hooked_up = _is_hooked_up(material)
                detail = None if is_hooked_up else self._replaced(found.detail)
                # What the nodes of an earlier bake do to normals is no loss.
                notes = {
                    socket: text for socket, text in found.notes.items() if not (is_hooked_up and socket == NORMAL)
                }
                found = replace(found, detail=detail, notes=notes | self._notes_on_maps(found))
            self._found[key] = replace(found, key=key)
        return self._found[key]

    def _replaced(self, detail: DetailFeed | None) -> NormalMapFeed | None:
        """The part of `detail` that the baked map takes the place of: a normal map that Imprint did not bake.

        Bump nodes stay above the baked map, and would count twice.
        """
        below = detail.below if isinstance(detail, BumpFeed) else detail
        return None if below is None or self.images.is_map(below.image.image) else below

    def _notes_on_maps(self, material: HighMaterial) -> dict[str, tuple[str, ...]]:
        """Sentences, by socket, about maps that an earlier bake has put into a material of the low object."""
        return {
            socket: (
                *material.notes.get(socket, ()),
                f'Material "{material.name}": {socket} shows a map that Imprint has baked, because the low object has this '
                "material, too. Give the high objects a material of their own to bake from the original.",
            )
            for socket, feed in material.feeds.items()
            if isinstance(feed, ImageFeed) and self.images.is_map(feed.image)
        }

    def number(self, material: Shown) -> int:
        """The number of a material that was read."""
        return 1 + list(self._found).index(_key(material))


def _key(material: Shown) -> int:
    return material.value if isinstance(material, Bare) else material.session_uid


def _is_hooked_up(material: bpy.types.Material) -> bool:
    """Whether a Normal Map node of this material was made by Imprint."""
    nodes = material.node_tree.nodes if material.node_tree else ()
    return any(node.bl_idname == "ShaderNodeNormalMap" and node.get(MARK) for node in nodes)
