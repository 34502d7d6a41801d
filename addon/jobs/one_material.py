# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives low objects one material, which shows their maps, in place of all that they have; also on copies, or joined.

What no map holds stays where all materials have it alike. The materials stay in the file, but the objects use them no more.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from bpy.types import Image, Material, Mesh, Object

from .. import older_blender
from ..core.errors import BakeError, shorten_list
from ..core.map_types import BY_NAME, MARK, NORMAL, OTHERS
from ..core.material_feeds import Constant
from ..core.naming import ATLAS
from ..core.report import Report
from ..core.settings import Settings, StorageSettings
from ..output import journal, materials
from ..scene import evaluation, object_checks
from ..scene.high_materials import sets_of
from ..scene.materials import material_reading
from ..scene.textures import ImageTextures
from . import joining

ROLE = "one material"
"""The mark of such a material, by which the next bake finds it again."""
PRINCIPLED = material_reading.PRINCIPLED
REFRACTION = "use_raytrace_refraction"
_SURFACE = (
    *("displacement_method", "surface_render_method", "use_backface_culling", "use_backface_culling_shadow"),
    REFRACTION,
)
"""Settings of a material that the new one has where all others agree."""


@journal.plain
@dataclass(frozen=True)
class Shown:
    """A low object with its maps."""

    low: Object
    uv_layer: str
    image: Image
    """The normal map."""
    maps: Mapping[str, dict]
    """As in Report.maps."""
    is_own_base: bool = True
    """Whether it was baked without its modifiers, which may set materials."""

    @classmethod
    def of(cls, report: Report) -> "Shown":
        """The maps of a finished bake. Raises BakeError if the object or the image is gone, or for a texture set."""
        low, *highs = (ref.resolve() for ref in report.refs[: 1 + len(report.high)])
        if report.slots:
            raise BakeError(f"{low.name!r} has an image for each material: bake it without Texture Sets.")
        image = bpy.data.images.get(report.image)
        if image is None:
            raise BakeError(f"The image {report.image!r} was undone, renamed or deleted: bake again.")
        return cls(low, report.uv_layer, image, report.maps, low in highs)


def check(low: Object, *, single_user: bool) -> None:
    """Raise BakeError if the materials of `low` cannot be replaced. single_user: whether it gets a mesh of its own for that."""
    if not _is_local(low):
        raise BakeError(f"{low.name!r} cannot get one material: it comes from a library. Make it local first.")
    if not single_user and not _is_local(low.data):
        raise BakeError(
            f"{low.name!r} cannot get one material: its mesh comes from a library. Make it local first, or turn Single User on."
        )


def check_apart(lows: Sequence[Object], storing: StorageSettings) -> None:
    """Raise BakeError if low objects that get an image each, and so a material each, have one mesh."""
    if not storing.one_material or storing.single_user:
        return
    for number, low in enumerate(lows):
        for other in lows[:number]:
            if other != low and other.data == low.data:
                raise BakeError(
                    f"{other.name!r} and {low.name!r} have the same mesh, and cannot get a material each: turn Single User "
                    "on, or bake them into one image."
                )


def _is_local(block: bpy.types.ID) -> bool:
    return block.is_editable and not block.override_library


@journal.recorded
def put(shown: Sequence[Shown], settings: Settings, name: str) -> list[str]:
    """Give all of `shown`, which share their images, one material with these. Returns warnings.

    settings: of the bake. name: of the material, if there is none of an earlier bake.
    """
    old = dict.fromkeys(material for each in shown for material in _used(each))
    lows = [each.low for each in shown]
    again = [material for material in old if len(old) == 1 and material.get(MARK) == ROLE]
    material, notes = (
        _taken_again(again[0], shown, settings, name) if again else _made(list(old), shown, settings, name)
    )
    for each in shown:
        notes += _alone(each.low, material, lows, single_user=settings.storing.single_user)
        layer = each.low.data.uv_layers.get(each.uv_layer)  # modifiers may make it
        if layer is not None:
            layer.active_render = True
    layers = {each.uv_layer for each in shown}
    layer = layers.pop() if len(layers) == 1 else ""
    return notes + materials.show_in(material, shown[0].image, shown[0].maps, layer, settings)


def put_checked(
    context: bpy.types.Context, shown: Sequence[Shown], settings: Settings, *, on_copies: bool, is_joined: bool
) -> list[str]:
    """As `put`, for objects that were baked before. Returns warnings.

    on_copies: whether copies get it; the objects stay, hidden in the viewport. is_joined: whether all become one object.
    Raises BakeError, and then nothing has changed.
    """
    lows, single_user = [each.low for each in shown], settings.storing.single_user
    is_joined = is_joined and len(lows) > 1
    for low in lows:
        if not on_copies:
            check(low, single_user=single_user)
        if on_copies or is_joined:
            evaluation.check_can_show(context, low)
    if is_joined:
        layers = [each.uv_layer for each in shown]
        joining.check(context, lows, layers, are_copied=on_copies, has_own_mesh=single_user)
    shown = _copied(context, shown) if on_copies else shown
    lows = [each.low for each in shown]
    warnings = put(shown, settings, ATLAS if len(lows) > 1 else lows[0].name)
    if is_joined:
        joining.join(context, lows)
    return warnings


def _used(shown: Shown) -> list[Material]:
    """The materials on the faces of a low object."""
    slots = [number for one in sets_of(shown.low, is_own_base=shown.is_own_base) for number in one.slots]
    return materials.of(shown.low, slots, is_own_base=shown.is_own_base)


def _taken_again(old: Material, shown: Sequence[Shown], settings: Settings, name: str) -> tuple[Material, list[str]]:
    """The one material of an earlier bake, or a copy if other objects would then show maps that they do not. Returns notes."""
    lows, single_user = [each.low for each in shown], settings.storing.single_user
    following = set() if single_user else {low.data for low in lows}  # they get what `lows` get
    layer = shown[0].uv_layer if _shows_all(old, shown[0], settings) else ""
    others = [
        repr(obj.name)
        for obj in bpy.data.objects
        if obj not in lows
        and any(
            slot.material == old and not (slot.link == "DATA" and obj.data in following) for slot in obj.material_slots
        )
        and not any(each.name == layer and each.active_render for each in getattr(obj.data, "uv_layers", ()))
        and not object_checks.is_deleted(obj)
    ]
    if not others and _is_local(old):
        return old, []
    copy = old.copy()
    copy.make_local()  # the copy of a library override is an override too
    copy.name = name
    whose = f"also on {shorten_list(others)}" if others else "linked from a library"
    names, verb = shorten_list(repr(low.name) for low in lows), "show" if lows[1:] else "shows"
    return copy, [f"The material {old.name!r} is {whose}: {names} now {verb} the copy {copy.name!r}."]


def _shows_all(material: Material, shown: Shown, settings: Settings) -> bool:
    """Whether a material has all images of the bake already, as for objects that share them."""
    images, _ = materials.images_of_report(shown.maps, settings.map.space)
    wanted = {each.image for each in images.values()} | ({shown.image} if settings.map.normal else set())
    return wanted <= {getattr(node, "image", None) for node in material.node_tree.nodes}


def _made(old: Sequence[Material], shown: Sequence[Shown], settings: Settings, name: str) -> tuple[Material, list[str]]:
    """The material, without the maps, and what they lack of the `old` ones, in sentences."""
    material = bpy.data.materials.new(name)
    material[MARK] = ROLE
    older_blender.switch_on_nodes(material)
    for setting in _SURFACE:
        values = {getattr(each, setting) for each in old if hasattr(each, setting)}
        if setting == REFRACTION:  # what is no glass looks the same with it
            values -= {False} if True in values else set()
        if len(values) == 1:
            setattr(material, setting, values.pop())
    shader = next(node for node in material.node_tree.nodes if node.bl_idname == PRINCIPLED)
    lacking = [*_set_maps_alike(shader, old, shown, settings), *_set_inputs_alike(shader, old)]
    if not lacking:
        return material, []
    names = shorten_list(repr(each.low.name) for each in shown)
    return material, [
        f"The materials of {names} differ in {shorten_list(lacking)}, which no baked map holds: the one material has the same "
        "everywhere. Bake these maps as well, if they are among the maps."
    ]


def _set_maps_alike(
    shader: bpy.types.Node, old: Sequence[Material], shown: Sequence[Shown], settings: Settings
) -> list[str]:
    """Set the inputs of the shader whose maps were not baked, where all materials have one number. Returns the other ones."""
    images, _ = materials.images_of_report(shown[0].maps, settings.map.space)
    baked = {BY_NAME[name].socket for name in images}
    surfaces = material_reading.read_materials(old, ImageTextures())
    lacking = []
    for map_type in OTHERS:
        socket = map_type.socket
        if not socket or socket in baked or map_type.label in lacking:
            continue
        baked.add(socket)
        feeds = [surface.feeds[socket] for surface in surfaces if socket in surface.feeds]
        values = {feed.color if isinstance(feed, Constant) else None for feed in feeds}
        if len(values) > 1 or None in values:
            lacking.append(map_type.label)
        elif values:
            _set(shader, socket, values.pop())
    if not settings.map.normal and any(surface.detail is not None for surface in surfaces):
        lacking.append(NORMAL.label)
    return lacking


def _set(shader: bpy.types.Node, socket: str, color: Sequence[float]) -> None:
    entry = shader.inputs[socket]
    entry.default_value = (*color[:3], 1.0) if entry.type == "RGBA" else color[0]
    if socket == material_reading.EMISSION:  # with its strength
        shader.inputs["Emission Strength"].default_value = 1.0 if any(color[:3]) else 0.0


def _set_inputs_alike(shader: bpy.types.Node, old: Sequence[Material]) -> list[str]:
    """Set the inputs that are no maps, such as IOR, where all Principled BSDFs agree. Returns the names of the other ones."""
    mapped = {map_type.socket for map_type in OTHERS} | {"Normal", "Emission Strength", "Weight"}
    shaders = [node for each in old if each.node_tree for node in each.node_tree.nodes if node.bl_idname == PRINCIPLED]
    lacking = []
    for entry in shader.inputs:
        others = [found for node in shaders if (found := node.inputs.get(entry.name)) is not None]
        if entry.name in mapped or not hasattr(entry, "default_value") or not others:
            continue
        values = {_plain(other) for other in others}
        if len(values) == 1 and not any(other.is_linked for other in others):
            entry.default_value = others[0].default_value
        elif _counts(entry.name, shaders):
            lacking.append(entry.name)
    return lacking


def _plain(entry: bpy.types.NodeSocket) -> object:
    value = entry.default_value
    return value if isinstance(value, int | float | str) else tuple(value)


def _counts(name: str, shaders: Sequence[bpy.types.Node]) -> bool:
    """Whether an input such as "Coat Roughness" has an influence: the weight of what it is part of is not 0 everywhere."""
    weights = [node.inputs.get(f"{name.partition(' ')[0]} Weight") for node in shaders]
    return any(each is None or each.is_linked or each.default_value > 0.0 for each in weights)


def _alone(low: Object, material: Material, lows: Sequence[Object], *, single_user: bool) -> list[str]:
    """Make `material` the only one of `low`, on all faces. lows: all that get it. Returns notes."""
    with evaluation.in_object_mode(bpy.context, [low]):
        others = object_checks.with_mesh_of(low, lows)
        if single_user and (others or not _is_local(low.data)):
            low.data = low.data.copy()
            low.data.make_local()  # the copy of a library override is an override too
            others = []
        data: Mesh = low.data
        if any(slot.link == "OBJECT" for obj in others for slot in obj.material_slots):
            for slot in low.material_slots:
                slot.link = "DATA"
            for number in range(len(data.materials)):  # without slots, the others would lose their own materials
                data.materials[number] = material
        elif [slot.material for slot in low.material_slots] != [material]:
            data.materials.clear()
            data.materials.append(material)
            data.polygons.foreach_set("material_index", np.zeros(len(data.polygons), np.int32))
            data.update()
    names = [repr(obj.name) for obj in others if any(slot.material == material for slot in obj.material_slots)]
    if not names:
        return []
    verb = "show" if names[1:] else "shows"
    return [f"The mesh of {low.name!r} is also that of {shorten_list(names)}, which {verb} the one material, too."]


def _copied(context: bpy.types.Context, shown: Sequence[Shown]) -> list[Shown]:
    """Copies of the objects with meshes of their own, in the same collections. The originals are hidden in the viewport."""
    result = []
    for each in shown:
        copy = each.low.copy()
        copy.data = each.low.data.copy()
        collections = [collection for collection in each.low.users_collection if collection.is_editable]
        for collection in collections or [context.scene.collection]:
            collection.objects.link(copy)
        each.low.hide_set(True)
        result.append(replace(each, low=copy))
    return result


def join(context: bpy.types.Context, reports: Sequence[Report]) -> None:
    """Join the low objects of bakes with one material into the first one. Raises BakeError if that would lose something."""
    shown = list(map(Shown.of, reports))
    lows = [each.low for each in shown]
    joining.check(context, lows, [each.uv_layer for each in shown])
    joining.join(context, lows)
