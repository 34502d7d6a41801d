# SPDX-License-Identifier: GPL-3.0-or-later
"""Which materials high meshes have, which UV maps, attributes and tangents those need, and the faces of one material."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial

import bpy
import numpy as np

from ..core import naming
from ..core.declarations import bases
from ..core.errors import BakeError
from ..core.map_types import BASE_COLOR, BY_NAME, MARK
from ..core.material_feeds import (
    AttributeFeed,
    BumpFeed,
    DetailFeed,
    ExactFeed,
    Feed,
    HighMaterial,
    ImageFeed,
    NormalMapFeed,
)
from ..core.settings import MapSettings
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import ATTRIBUTE, GENERATED, TANGENTS, UV_LAYER, Mesh
from . import mesh_elements, mesh_reader
from .materials.material_reading import NORMAL, read_materials
from .textures import ImageTextures

READERS = {
    UV_LAYER: mesh_elements.uv_by_corner,
    ATTRIBUTE: mesh_elements.attribute_by_corner,
    TANGENTS: mesh_elements.tangents_by_corner,
}
"""What reads each kind of Mesh.layers; None where the mesh lacks it."""


def read_layers(
    obj: bpy.types.Object,
    data: bpy.types.Mesh,
    materials: Iterable[HighMaterial],
    map_settings: MapSettings,
    *,
    for_render: bool,
) -> dict[tuple[str, str], np.ndarray]:
    """Those of `data`, the mesh of `obj`, that its materials need for the maps of the settings, as Mesh.layers has them.

    for_render: whether `data` has the modifiers that renders see.
    """
    generated = partial(mesh_elements.generated_by_corner, obj, data, for_render=for_render)
    layers = {
        key: generated() if key[0] == GENERATED else READERS[key[0]](data, key[1])
        for key in _needed(materials, map_settings)
    }
    return {key: values for key, values in layers.items() if values is not None}


def _needed(materials: Iterable[HighMaterial], map_settings: MapSettings) -> dict[tuple[str, str], None]:
    """The keys of the layers, each once, in order."""
    wanted = [BY_NAME[name] for name in map_settings.drawn_maps if BY_NAME[name].family.shows_materials]
    needed: dict[tuple[str, str], None] = {}
    if any(not map_type.socket for map_type in wanted):
        needed[ATTRIBUTE, map_settings.attribute] = None
    for material in materials:
        for map_type in wanted:
            needed |= dict.fromkeys(_of_feed(material.feeds.get(map_type.socket)))
        if map_settings.detail_maps and material.detail is not None:
            needed |= dict.fromkeys(_of_detail(material.detail))
        if material.cutout is not None:
            needed |= dict.fromkeys(_of_feed(material.cutout.feed))
    return needed


def _of_feed(feed: Feed | None) -> Iterator[tuple[str, str]]:
    if isinstance(feed, ImageFeed):
        yield UV_LAYER, feed.uv_layer
    elif isinstance(feed, AttributeFeed):
        yield ATTRIBUTE, feed.name
    elif isinstance(feed, ExactFeed):
        yield from feed.layers


def _of_detail(detail: DetailFeed) -> Iterator[tuple[str, str]]:
    if isinstance(detail, ExactFeed):
        yield from _of_feed(detail)
        return
    yield from _of_feed(detail.image)
    if isinstance(detail, BumpFeed):
        if detail.below is not None:
            yield from _of_detail(detail.below)
    else:
        yield TANGENTS, detail.uv_layer


class Bare(IntEnum):
    """Faces without a material. Their values are keys that no material has."""

    PLAIN = 0
    COLORED = -1
    """With vertex colors."""


Shown = bpy.types.Material | Bare
"""What a slot shows."""


@dataclass(frozen=True)
class Itself:
    """Of an object that is baked onto itself.

    Attributes:
        layers: The names of the UV map that is baked onto, in nodes.
        basis: Of the baked map, by whose rules the object's own normal maps are read: they come back as they are.
    """

    layers: frozenset[str] = frozenset()
    basis: str = bases.CYCLES.name

    def read(self, detail: DetailFeed | None) -> DetailFeed | None:
        """`detail` with the basis of its normal maps."""
        if isinstance(detail, BumpFeed):
            return replace(detail, below=self.read(detail.below))
        if isinstance(detail, NormalMapFeed):
            return replace(detail, basis=self.basis) if detail.uv_layer in self.layers else detail
        of_maps = {name for kind, name in detail.layers if kind == TANGENTS} if detail is not None else set()
        return replace(detail, basis=self.basis) if of_maps and of_maps <= self.layers else detail


class MaterialNumbers:
    """The materials by their numbers, which count from 1.

    sockets, is_exact: as read_materials takes them. low: the low object, evaluated; what the bake leaves in its materials is
    no detail of a high object that shows the same material. itself: if the low object is baked onto itself, where nothing is
    left in its materials. before: those of an earlier reading, which keep their numbers.
    """

    def __init__(
        self,
        images: ImageTextures,
        low: bpy.types.Object,
        *,
        sockets: Collection[str],
        is_exact: bool = False,
        itself: Itself | None = None,
        before: Sequence[HighMaterial] = (),
    ):
        self.images, self.sockets, self.is_exact, self.itself = images, sockets, is_exact, itself
        self._of_low = {material for material in materials_of(low) if material}
        self._found: dict[int, HighMaterial] = {material.key: material for material in before}

    @property
    def materials(self) -> list[HighMaterial]:
        """In the order of their numbers."""
        return list(self._found.values())

    def of_slots(self, obj: bpy.types.Object, data: bpy.types.Mesh) -> list[Shown]:
        """What each slot of the evaluated object `obj` shows on its mesh `data`; at least one."""
        # Scans often have vertex colors and no material.
        bare = Bare.COLORED if data.attributes.get(data.attributes.default_color_name or "") else Bare.PLAIN
        return [material or bare for material in materials_of(obj)] or [bare]

    def read(self, material: Shown) -> HighMaterial:
        """What feeds a material."""
        key = _material_key(material)
        if key not in self._found:
            is_bare = isinstance(material, Bare)
            plain = None if is_bare else material
            surface = read_materials([plain], self.images, self.sockets, is_exact=self.is_exact)[0]
            if material is Bare.COLORED:
                surface = replace(surface, feeds=surface.feeds | {BASE_COLOR.socket: AttributeFeed("")})
            if material in self._of_low:
                if self.itself:
                    surface = replace(surface, detail=self.itself.read(surface.detail))
                else:
                    surface = self._without_what_stays(material, surface)
                surface = replace(surface, notes=surface.notes | self._notes_on_maps(surface))
            self._found[key] = replace(surface, key=key)
        return self._found[key]

    def _without_what_stays(self, material: bpy.types.Material, surface: HighMaterial) -> HighMaterial:
        """`surface` without the detail that the low object shows beside the baked map."""
        notes = {socket: text for socket, text in surface.notes.items() if socket != NORMAL}
        if _is_hooked_up(material):  # what the nodes of an earlier bake do to normals is no loss
            return replace(surface, detail=None, notes=notes)
        if isinstance(surface.detail, ExactFeed):
            plain = read_materials([material], self.images, {NORMAL})[0]
            surface = replace(surface, detail=plain.detail, notes=notes | plain.notes)
        return replace(surface, detail=self._replaced(surface.detail))

    def give_up(self, numbers: Collection[int], is_unknown: Callable[[ExactFeed], bool], why: str) -> None:
        """Leave out what Cycles would evaluate on materials with these numbers, where `is_unknown`. why: a clause."""
        for number in numbers:
            material = self.materials[number - 1]
            lost = [
                socket for socket, feed in material.feeds.items() if isinstance(feed, ExactFeed) and is_unknown(feed)
            ]
            feeds = {socket: feed for socket, feed in material.feeds.items() if socket not in lost}
            detail = material.detail
            if isinstance(detail, ExactFeed) and is_unknown(detail):
                detail = None
                lost.append(NORMAL)
            notes = {socket: (f'Material "{material.name}": {socket} is left out, because {why}.',) for socket in lost}
            self._found[material.key] = replace(material, feeds=feeds, detail=detail, notes=material.notes | notes)

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
                "material, too. For the original, bake from a material that shows it.",
            )
            for socket, feed in material.feeds.items()
            if isinstance(feed, ImageFeed) and self.images.is_map(feed.image)
        }

    def number(self, material: Shown) -> int:
        """The number of a material that was read."""
        return 1 + list(self._found).index(_material_key(material))


def _material_key(material: Shown) -> int:
    return material.value if isinstance(material, Bare) else material.session_uid


def _is_hooked_up(material: bpy.types.Material) -> bool:
    """Whether a Normal Map node of this material was made by Imprint."""
    nodes = material.node_tree.nodes if material.node_tree else ()
    return any(node.bl_idname == "ShaderNodeNormalMap" and node.get(MARK) for node in nodes)


def materials_of(obj: bpy.types.Object) -> list[bpy.types.Material | None]:
    """The material in each slot of `obj`. An evaluated object also has the slots that its modifiers add."""
    return [slot.material.original if slot.material else None for slot in obj.material_slots]


NO_MATERIAL = "none"
"""The name of the set of faces without a material."""


@dataclass(frozen=True)
class MaterialSet:
    """The faces of a low object with one material.

    Attributes:
        slots: The numbers of the slots that have it.
        name: Of the material, see naming.of_material.
    """

    name: str
    slots: tuple[int, ...]


def sets_of(low: bpy.types.Object, *, is_own_base: bool) -> list[MaterialSet]:
    """The materials on the faces of `low`, in the order of its slots, as the viewport shows it.

    is_own_base: whether it is baked without its modifiers.
    """
    if not is_own_base and low.modifiers and low.mode == "OBJECT":  # modifiers may set materials, and leave faces out
        shown = low.evaluated_get(bpy.context.evaluated_depsgraph_get())
        low = shown if shown.type == "MESH" and shown.data.polygons else low
    worn = materials_of(low) or [None]
    names = [naming.of_material(material) if material else NO_MATERIAL for material in worn]
    if low.type != "MESH" or not low.data.polygons:  # a check refuses it with a sentence
        return [MaterialSet(names[0], (0,))]
    used = np.unique(mesh_reader.face_values(low.data, "material_index").clip(0, len(names) - 1)).tolist()
    return [
        MaterialSet(name, tuple(number for number in used if names[number] == name))
        for name in dict.fromkeys(names[number] for number in used)
    ]


def with_slots(mesh: Mesh, data: bpy.types.Mesh, obj: bpy.types.Object) -> Mesh:
    """`mesh`, which was read from `data` with faces, labeled with the slots of `obj`: (T, 1)."""
    slots = mesh_reader.material_slots(data, mesh, max(1, len(obj.material_slots)))
    return replace(mesh, labels=slots[:, None].astype(np.float32))


def restricted(meshes: Meshes, chosen: MaterialSet) -> Meshes:
    """`meshes` with only those triangles of the low mesh and of its basis that are in a texture set.

    Both are labeled with their slots. `whole` keeps the low mesh as it was. Raises BakeError if no triangle is left.
    """
    kept = np.flatnonzero(np.isin(meshes.low.labels[:, 0], chosen.slots))
    if not len(kept):
        raise BakeError(f"{meshes.low.name!r} has no faces with the material {chosen.name!r}.")
    basis = meshes.basis
    if basis is not None:
        basis = basis.with_triangles(np.isin(basis.labels[:, 0], chosen.slots))
    return replace(
        meshes, low=meshes.low.with_triangles(kept), basis=basis, whole=meshes.low, kept=kept, material=chosen.name
    )
