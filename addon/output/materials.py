# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows the maps of a bake in the materials of the low object: finds their images, also the channels of a packed one."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType

import bpy
import numpy as np
from bpy.types import Image, Material, MaterialSlot, Mesh, Object

from .. import older_blender
from ..core import foreach, naming
from ..core.declarations.choices import Space
from ..core.errors import BakeError, Fix, shorten_list
from ..core.map_types import BY_NAME, MARK, MapType
from ..core.settings import Settings
from . import datablocks, journal, map_nodes, shared_maps
from .map_nodes import MapImage
from .outputs import Stored
from .tree_editing import Coordinates


def takes_any(maps: Mapping[str, dict]) -> bool:
    """Whether an input of a material takes one of the maps, as in Report.maps."""
    return any(_parts(name, how) for name, how in maps.items())


def images_of_report(maps: Mapping[str, dict], space: str) -> tuple[dict[str, MapImage], list[str]]:
    """The images of maps as in Report.maps, by the names in map_types, and warnings about images that are gone or empty.

    A map that is packed as well comes from the packed image: the material then needs one image less. Maps that no input of a
    material takes, and those without a value, are left out. space: as in Settings.
    """
    images: dict[str, MapImage] = {}
    gone, empty = [], []
    for name, how in sorted(maps.items(), key=lambda item: "channels" in item[1]):
        parts = _parts(name, how)
        image = datablocks.get(how["image"])
        if parts and image is None:
            gone.append(how["image"])
            continue
        for channel, part in parts.items():
            map_type = _map_type(part)
            if part.get("empty"):  # an input that it fed would be black
                empty.append(map_type.label)
                continue
            images[map_type.name] = MapImage(
                image,
                role=name,
                label=map_type.label if not channel else "Packed",
                channel=channel.capitalize(),
                is_inverted=part.get("inverted", False),
                midlevel=part["midlevel"],
                scale=part["scale"],
                space=space,
                is_tangent=part.get("space") == Space.TANGENT,
            )
    warnings = []
    if gone:
        warnings.append(
            f"Images that were undone, renamed or deleted are not connected: {shorten_list(map(repr, gone))}."
        )
    if empty:
        warnings.append(f"Maps without a value are not connected: {shorten_list(dict.fromkeys(empty))}.")
    return images, warnings


def _parts(name: str, how: dict) -> dict[str, dict]:
    """The channels of an image of Report.maps that an input of a material takes. "" means the whole image."""
    parts = how["channels"] if "channels" in how else {"": how | {"map": name}}
    return {channel: part for channel, part in parts.items() if map_nodes.takes_map(_map_type(part))}


def _map_type(part: dict) -> MapType | None:
    return BY_NAME.get(part.get("map", "").upper())


CONVENTIONS: Mapping[tuple[str, str, str], str] = MappingProxyType(
    {("+X", "+Y", "+Z"): "OPENGL", ("+X", "-Y", "+Z"): "DIRECTX"}
)
"""The channels that the Normal Map node can read, with Blender's identifiers."""


def check(low: Object, *, can_be_off: bool = True) -> None:
    """Raise BakeError if `hook_up` cannot change the materials of `low`. Called before the bake. can_be_off: whether they stay
    as they are without the setting Material."""
    if not low.is_editable:
        cause = f'"{low.name}" is linked from a library, so its materials cannot be set: make it local first.'
        raise BakeError(Fix.NO_MATERIAL.after(cause) if can_be_off else cause)
    if not low.material_slots and not _is_local(low.data):
        raise BakeError(
            f'"{low.name}" has no material, and its mesh "{low.data.name}" is linked from a library and cannot be '
            "given one: make the mesh local first."
        )


def hook_up(
    low: Object,
    image: Image,
    *,
    space: str,
    uv_layer: str,
    channels: tuple[str, str, str],
    single_user: bool = False,
    slots: Sequence[int] | None = None,
    is_own_base: bool = False,
) -> list[str]:
    """Show the image as the normal map of every material on the faces of low. Returns notes for the report.

    space, channels: of the map, as in Settings; the axes in red, green and blue. single_user: first copy materials that are
    linked from a library or used by other objects. slots: the numbers of the slots whose
    materials change; None for all. is_own_base: whether low was baked without its modifiers, which may set materials.
    """
    settings, notes = _normal_map(image, space, uv_layer, channels)
    if settings is None:
        return notes
    connect = partial(map_nodes.connect_normals, settings=settings, coordinates=_coordinates(low, uv_layer))
    return _edit(low, connect, [image], single_user=single_user, slots=slots, is_own_base=is_own_base)


def _normal_map(
    image: Image, space: str, uv_layer: str, channels: tuple[str, str, str]
) -> tuple[map_nodes.NormalMapSettings | None, list[str]]:
    """The settings of the nodes of a normal map, or None and why no node reads it."""
    image[MARK] = True
    if channels not in CONVENTIONS:
        return None, [f"No Normal Map node reads channels of {', '.join(channels)}: the material was left as it is."]
    normal_map = {"space": space, "convention": CONVENTIONS[channels]}
    if space == Space.TANGENT:
        normal_map["uv_map"] = uv_layer
    return map_nodes.NormalMapSettings(image, normal_map), []


def show_in(material: Material, image: Image, maps: Mapping[str, dict], uv_layer: str, settings: Settings) -> list[str]:
    """Show all maps of a bake, as in Report.maps, in one material. Returns warnings. image: the normal map.

    uv_layer: the UV map that renders see; "" for that of each object.
    """
    coordinates = Coordinates(uv_layer, (uv_layer, ""))
    images, notes = images_of_report(maps, settings.map.space)
    if settings.map.normal:
        normal_map, unread = _normal_map(image, settings.map.space, uv_layer, settings.map.channels)
        notes += unread if normal_map is None else map_nodes.connect_normals(material, normal_map, coordinates)
    for each in images.values():
        each.image[MARK] = True
    return notes + map_nodes.connect_surface(material, images, coordinates)


def connect_maps(
    low: Object,
    images: Mapping[str, MapImage],
    *,
    uv_layer: str,
    single_user: bool = False,
    slots: Sequence[int] | None = None,
    is_own_base: bool = False,
) -> list[str]:
    """Connect other maps, by their names, to the inputs of every material on the faces of low. Returns notes for the report.

    single_user, slots, is_own_base: as in `hook_up`.
    """
    for image in images.values():
        image.image[MARK] = True
    coordinates = _coordinates(low, uv_layer)
    connect = partial(map_nodes.connect_surface, images=images, coordinates=coordinates)
    shown = [each.image for each in images.values()]
    return _edit(low, connect, shown, single_user=single_user, slots=slots, is_own_base=is_own_base)


@journal.recorded
def into_materials(
    low: Object,
    stored: Stored,
    uv_layer: str,
    settings: Settings,
    *,
    slots: Sequence[int] | None = None,
    is_own_base: bool = False,
) -> list[str]:
    """Show the stored maps in the materials of `low`, as far as the settings say. Returns warnings.

    slots: the numbers of the material slots that a texture set belongs to; None for all. is_own_base: as in `hook_up`.
    """
    warnings = []
    if settings.storing.material and settings.map.normal:
        warnings += show_normal_map(low, stored.image, uv_layer, settings, slots=slots, is_own_base=is_own_base)
    if settings.storing.connect_maps:
        warnings += connect_maps_of_report(
            low,
            stored.maps,
            uv_layer,
            space=settings.map.space,
            single_user=settings.storing.single_user,
            slots=slots,
            is_own_base=is_own_base,
        )
    return list(dict.fromkeys(warnings))


@journal.recorded
def fill_slots(
    low: Object, name: str, together: Sequence[Object], *, single_user: bool = False, is_own_base: bool = False
) -> None:
    """Put one material into the empty slots that faces of `low` use: the one of this name that objects of `together` show, or
    a new one. single_user, is_own_base: as in `hook_up`."""
    shown = [slot.material for obj in together for slot in obj.material_slots if slot.material]
    known = next((material for material in shown if name in (naming.of_material(material), material.get(BARE))), None)
    _fill_slots(low, _shown(low, is_own_base=is_own_base), single_user, name, known)


BARE = "imprint_bare"
"""The custom property of a material for faces that had none: the name that it was to have, which another one may have."""


def show_normal_map(
    low: Object,
    image: Image,
    uv_layer: str,
    settings: Settings,
    *,
    slots: Sequence[int] | None = None,
    is_own_base: bool = False,
) -> list[str]:
    """Show `image` as the normal map in the materials of `low`. Returns warnings. slots, is_own_base: as in `hook_up`."""
    return hook_up(
        low,
        image,
        space=settings.map.space,
        uv_layer=uv_layer,
        channels=settings.map.channels,
        single_user=settings.storing.single_user,
        slots=slots,
        is_own_base=is_own_base,
    )


def connect_maps_of_report(
    low: Object,
    maps: dict[str, dict],
    uv_layer: str,
    *,
    space: str,
    single_user: bool,
    slots: Sequence[int] | None = None,
    is_own_base: bool = False,
) -> list[str]:
    """Connect maps other than the normal map, as in Report.maps, in the materials of `low`. Returns warnings.

    Maps whose images are no longer there are left out, with a warning. space, single_user: as in Settings. slots,
    is_own_base: as in `hook_up`.
    """
    images, warnings = images_of_report(maps, space)
    if not images:
        return warnings
    return warnings + connect_maps(
        low, images, uv_layer=uv_layer, single_user=single_user, slots=slots, is_own_base=is_own_base
    )


def _coordinates(low: Object, uv_layer: str) -> Coordinates:
    is_default = any(layer.name == uv_layer and layer.active_render for layer in low.data.uv_layers)
    return Coordinates(uv_layer, (uv_layer, "") if is_default else (uv_layer,))


def _edit(
    low: Object,
    connect: Callable[[Material], list[str]],
    shown: Sequence[Image],
    *,
    single_user: bool,
    slots: Sequence[int] | None,
    is_own_base: bool,
) -> list[str]:
    """Call `connect` with every material on the faces of low that can be changed. slots, is_own_base: as in `hook_up`.

    shown: what they show then. Returns notes, with those of `connect`.
    """
    _fill_slots(low, _shown(low, is_own_base=is_own_base), single_user, low.name)
    sharers = _sharers(low)
    notes = []
    with_map = {part.name for image in shown for part in shared_maps.parts_of_image(image.name)}
    alike = [low, *(obj for obj in bpy.data.objects if obj != low and obj.name in with_map and obj.is_editable)]
    own = {slot.material for slot in low.material_slots}
    for material in of(low, slots, is_own_base=is_own_base):
        is_local, others = _is_local(material), [name for name in sharers[material] if name not in with_map]
        state = f'Material "{material.name}" ' + (_list(others) if is_local else "is linked from a library")
        target = material
        if single_user and (others or not is_local) and material in own:
            target = _copy_for(alike, material)
            notes.append(f'{state}; "{low.name}" now uses the copy "{target.name}".')
        elif not is_local:
            notes.append(f"{state} and was left as it is; make it local, or ask for a single-user copy.")
            continue
        elif others:
            notes.append(f"{state}; the map shows there too.")
        notes.extend(older_blender.switch_on_nodes(target))
        notes.extend(connect(target))
    return notes


def _is_local(datablock: Material | Mesh) -> bool:
    """Whether Blender saves edits. A library override of a mesh or material loses new slots and nodes when it is loaded."""
    return datablock.is_editable and not datablock.override_library


def of(low: Object, slots: Sequence[int] | None = None, *, is_own_base: bool) -> list[Material]:
    """The materials that `low` shows, each once, also those that its modifiers set. slots, is_own_base: as in `hook_up`."""
    in_slots = [slot.material for slot in _shown(low, is_own_base=is_own_base).material_slots]
    # Slots may have been removed since the bake.
    chosen = [material for number, material in enumerate(in_slots) if slots is None or number in slots]
    return list(dict.fromkeys(material.original for material in chosen if material))


def _shown(low: Object, *, is_own_base: bool) -> Object:
    """`low`, evaluated where modifiers may set its materials."""
    if is_own_base or not low.modifiers or low.mode != "OBJECT":
        return low
    evaluated = low.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return evaluated if evaluated.data.polygons else low


def _fill_slots(low: Object, shown: Object, single_user: bool, name: str, known: Material | None = None) -> None:
    """Put one material, `known` or a new one, into all empty slots that the faces of low use. shown: as `_shown` returns it."""
    if not shown.material_slots:
        low.data.materials.append(None)
        shown = low
    slots = shown.material_slots
    if all(slot.material for slot in slots):
        return
    faces = foreach.read(shown.data.polygons, "material_index")
    used = np.unique(faces.clip(0, len(slots) - 1))  # a face whose index is too high shows the last slot
    own = low.material_slots
    empty = [own[i] for i in used.tolist() if not slots[i].material and i < len(own) and not own[i].material]
    if empty:
        material = known or bpy.data.materials.new(name)
        older_blender.switch_on_nodes(material)
        if known is None and name != low.name:
            material[BARE] = name
        for slot in empty:
            _assign(low, slot, material, single_user)


def _copy_for(lows: Sequence[Object], material: Material) -> Material:
    """Replace the material in the slots of objects by a copy, and return the copy."""
    copy = material.copy()
    copy.make_local()  # the copy of a library override is an override too
    copy[naming.COPY_OF] = {"name": copy.name, "of": naming.of_material(material)}
    for low in lows:
        for slot in low.material_slots:
            if slot.material == material:
                _assign(low, slot, copy, True)
    return copy


def _assign(low: Object, slot: MaterialSlot, material: Material, single_user: bool) -> None:
    """Put the material into the slot. Link it to the object if the mesh cannot be changed, or other objects share it."""
    if slot.link == "DATA" and (not _is_local(low.data) or (single_user and low.data.users > 1)):
        slot.link = "OBJECT"
    slot.material = material


def _sharers(low: Object) -> dict[Material, list[str]]:
    """The names of the other objects that use each material."""
    sharers: dict[Material, list[str]] = defaultdict(list)
    for obj in bpy.data.objects:
        if obj != low and obj.users:  # an object without users was deleted, but not purged yet
            for material in {slot.material for slot in obj.material_slots}:
                sharers[material].append(obj.name)
    return sharers


def _list(names: Sequence[str]) -> str:
    listed = ", ".join(f'"{name}"' for name in names[:3]) + (", ..." if len(names) > 3 else "")
    return f"is also on {len(names)} other object{'s' if len(names) > 1 else ''} ({listed})"
