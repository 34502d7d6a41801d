# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects: references to them that last, and whether they can be baked."""

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ..core import naming
from ..core.declarations.choices import Method
from ..core.errors import UNWRAP_FIRST, BakeError, shorten_list
from .mesh_reader import count_triangles

GONE = -1
"""The uid of an object that does not exist."""


@dataclass(frozen=True)
class ObjectRef:
    """A reference to an object that stays valid if the object is renamed, or deleted and restored by Undo.

    A bpy reference crashes after Undo, and a name may also belong to a linked or a newer object.

    Attributes:
        uid: Its session_uid, or 0 for any object of that name.
        name: Its name when `of` was called.
        library: The absolute path of the library of a linked object; reloading the library gives the object another
            session_uid.
    """

    uid: int
    name: str
    library: str = ""

    @classmethod
    def of(cls, obj: bpy.types.Object) -> "ObjectRef":
        """A reference to `obj`."""
        return cls(obj.session_uid, obj.name, _library(obj))

    def find(self) -> bpy.types.Object | None:
        """The object, or None if it was deleted."""
        existing = bpy.data.objects.get(self.name)  # nearly always right, and much faster than a search
        if existing is None or self.uid not in {0, existing.session_uid}:
            existing = next((obj for obj in bpy.data.objects if obj.session_uid == self.uid), None)
        if existing is None and self.library:
            existing = next(
                (obj for obj in bpy.data.objects if obj.name == self.name and _library(obj) == self.library), None
            )
        return existing

    def resolve(self) -> bpy.types.Object:
        """The object. Raises BakeError if it was deleted."""
        if not self.uid:
            return object_by_name(self.name)
        obj = self.find()
        if obj is None:
            raise self._deleted()
        return obj

    def check_kept(self) -> None:
        """Raise BakeError if the object was deleted, also while a slot of the panel still keeps it in the file."""
        if is_deleted(self.resolve()):
            raise self._deleted()

    def _deleted(self) -> BakeError:
        return BakeError(f"{self.name!r} was deleted: bring it back with Undo, or choose another object.")


def is_deleted(obj: bpy.types.Object) -> bool:
    """Whether the user has deleted a local object that a pointer still keeps: it is in no collection."""
    if obj.library is not None or bpy.context.view_layer.objects.get(obj.name) == obj:
        return False
    return not obj.users_collection  # slower: it goes through all collections


def with_mesh_of(low: bpy.types.Object, lows: Collection[bpy.types.Object]) -> list[bpy.types.Object]:
    """The objects beside `lows` that have the mesh of `low`."""
    return [obj for obj in bpy.data.objects if obj.data == low.data and obj not in lows and not is_deleted(obj)]


FLOATER = "imprint_floater"
"""A custom property of an object that gives detail and blocks no rays of ambient occlusion. It needs no add-on."""


def is_floater(obj: bpy.types.Object) -> bool:
    """Whether an object gives detail and blocks no rays of ambient occlusion."""
    return bool(obj.get(FLOATER, False))


def object_by_name(name: str) -> bpy.types.Object:
    """The object with this name. Raises BakeError, with similar names, if there is none."""
    if name not in bpy.data.objects:
        raise BakeError(naming.no_such_object(name, bpy.data.objects.keys()))
    return bpy.data.objects[name]


def by_name(objects: Iterable[bpy.types.Object], like: bpy.types.Object | None = None) -> dict[str, bpy.types.Object]:
    """Objects by their names. Of several with one name, as an override and what it overrides, it is the one from the library of
    `like`, or else the local one."""
    library, by_name = like.library if like is not None else None, {}
    for obj in objects:
        if obj is None:  # a script has removed it since the view layer was updated
            continue
        if obj.name not in by_name or obj.library == library:
            by_name[obj.name] = obj
    return by_name


def scene_by_uid(uid: int) -> bpy.types.Scene | None:
    """The scene with this session_uid, or None if it was deleted."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


def _library(obj: bpy.types.Object) -> str:
    """The absolute path of the library that `obj` is linked from; empty for a local object."""
    return os.path.abspath(bpy.path.abspath(obj.library.filepath)) if obj.library else ""


SURFACES = {"CURVE", "SURFACE", "FONT", "META"}
"""Object types, besides meshes, that Blender converts to meshes."""
WITH_NODES = {"CURVES", "POINTCLOUD"}
"""Object types that show meshes if geometry nodes create some."""


def may_show(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show a mesh or instances."""
    if obj.type == "EMPTY":
        return obj.instance_type == "COLLECTION" and obj.instance_collection is not None
    return obj.type in {"MESH", *SURFACES} or (obj.type in WITH_NODES and _has_nodes(obj))


def is_line(obj: bpy.types.Object) -> bool:
    """Whether `obj` is a curve without faces, as paths and guides are."""
    if obj.type != "CURVE" or obj.modifiers:
        return False
    curve = obj.data
    is_filled = (
        curve.dimensions == "2D" and curve.fill_mode != "NONE" and any(one.use_cyclic_u for one in curve.splines)
    )
    is_tube = curve.bevel_object is not None if curve.bevel_mode == "OBJECT" else curve.bevel_depth != 0.0
    return not (is_filled or is_tube or curve.extrude)


def shows_more(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show more than its own mesh."""
    return obj.type != "MESH" or obj.instance_type != "NONE" or _has_nodes(obj) or len(obj.particle_systems) > 0


def shows_itself(obj: bpy.types.Object, *, for_render: bool) -> bool:
    """Whether `obj` shows its own mesh, which objects with instances can hide."""
    if obj.type != "MESH":
        return False
    if obj.instance_type == "NONE" and not len(obj.particle_systems):
        return True
    return obj.show_instancer_for_render if for_render else obj.show_instancer_for_viewport


ALIKE = {
    *(
        "ARMATURE",
        "BEVEL",
        "CAST",
        "CORRECTIVE_SMOOTH",
        "DECIMATE",
        "DISPLACE",
        "EDGE_SPLIT",
        "HOOK",
        "LAPLACIANSMOOTH",
    ),
    *(
        "LATTICE",
        "MASK",
        "MIRROR",
        "MULTIRES",
        "NORMAL_EDIT",
        "REMESH",
        "SIMPLE_DEFORM",
        "SMOOTH",
        "SOLIDIFY",
        "SUBSURF",
    ),
    *("TRIANGULATE", "UV_PROJECT", "UV_WARP", "WEIGHTED_NORMAL", "WELD", "WIREFRAME"),
}
"""Modifier types that do the same in renders as in the viewport, apart from their levels."""


def may_differ_in_renders(obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Whether renders may see another mesh of `obj` than the viewport shows. Evaluates nothing, and is true where unsure."""
    if obj.type != "MESH" or shows_more(obj):
        return True
    for modifier in obj.modifiers:
        if modifier.type not in ALIKE or modifier.show_viewport != modifier.show_render:
            return True
        has_levels = hasattr(modifier, "render_levels")
        if has_levels and (modifier.levels != modifier.render_levels or scene.render.use_simplify):
            return True
        texture = getattr(modifier, "texture", None)
        if texture is not None and texture.type == "IMAGE":  # the viewport may still show what the image was before
            return True
    return bool(obj.modifiers) and obj.animation_data is not None  # it may drive them


def instance_sources(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects that `obj` shows, but whose changes Blender does not report as changes of `obj`.

    These are the objects of an instanced collection, and children."""
    if obj.instance_type in {"VERTS", "FACES"}:
        yield from obj.children
    elif obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
        for inner in obj.instance_collection.all_objects:
            yield inner
            yield from instance_sources(inner)


def shown_by(owners: Sequence[bpy.types.Object]) -> dict[int, set[int]]:
    """The session_uids of the owners that show an object as an instance, by the session_uid of that object."""
    shown_by: dict[int, set[int]] = {}
    for owner in owners:
        for obj in instance_sources(owner):
            shown_by.setdefault(obj.session_uid, set()).add(owner.session_uid)
    return shown_by


def _has_nodes(obj: bpy.types.Object) -> bool:
    return any(modifier.type == "NODES" for modifier in obj.modifiers)


ADDING = {
    "BEVEL",
    "BOOLEAN",
    "DISPLACE",
    "MULTIRES",
    "OCEAN",
    "REMESH",
    "SUBSURF",
    "WAVE",
}
"""Modifier types that keep the base mesh in place and add detail to its surface.

Other types move or copy the mesh, cut its faces, or change only normals, UVs and groups. Baked onto the base mesh, they give a
flat map."""

PASS_THROUGH = {
    "GeometryNodeCaptureAttribute",
    "GeometryNodeJoinGeometry",
    "GeometryNodeMenuSwitch",
    "GeometryNodeRemoveAttribute",
    "GeometryNodeRenameAttribute",
    "GeometryNodeReplaceMaterial",
    "GeometryNodeSetID",
    "GeometryNodeSetMaterial",
    "GeometryNodeSetMaterialIndex",
    "GeometryNodeSetMeshNormal",
    "GeometryNodeSetShadeSmooth",
    "GeometryNodeSplitEdges",
    "GeometryNodeStoreNamedAttribute",
    "GeometryNodeSwitch",
    "GeometryNodeTriangulate",
    "GeometryNodeViewer",
    "GeometryNodeWarning",
    "NodeGroupInput",
    "NodeReroute",
}
"""Geometry nodes that do not change the surface. Shade Auto Smooth uses only these."""


def is_added(obj: bpy.types.Object) -> bool:
    """Whether a modifier of `obj`, enabled for the viewport or for rendering, may add detail.

    Fast enough for every redraw: it only reads types, and evaluates nothing.
    """
    return any(_adds_detail(modifier) for modifier in obj.modifiers if modifier.show_viewport or modifier.show_render)


def _shows_other_uvs(obj: bpy.types.Object) -> bool:
    layers = obj.data.uv_layers if obj.type == "MESH" else ()
    return len(layers) > 1 and not (layers.active or layers[0]).active_render


def _adds_detail(modifier: bpy.types.Modifier) -> bool:
    if modifier.type == "NODES":
        return modifier.node_group is not None and any(map(_changes_surface, _node_groups(modifier.node_group, set())))
    return modifier.type in ADDING


def textures_of(obj: bpy.types.Object) -> dict[str, bpy.types.Material]:
    """The materials of `obj` by the names of the local images that their nodes read."""
    found = {}
    for material in filter(None, (slot.material for slot in obj.material_slots)):
        for node in _node_groups(material.node_tree, set()) if material.node_tree else ():
            image = getattr(node, "image", None)
            if image is not None and image.library is None and any(socket.is_linked for socket in node.outputs):
                found.setdefault(image.name, material)
    return found


def _changes_surface(node: bpy.types.Node) -> bool:
    return node.bl_idname not in PASS_THROUGH and any(socket.type == "GEOMETRY" for socket in node.outputs)


def _node_groups(tree: bpy.types.NodeTree, seen: set[bpy.types.NodeTree]) -> Iterator[bpy.types.Node]:
    """The nodes of `tree` and of the groups in it, without the group nodes themselves."""
    seen.add(tree)
    for node in tree.nodes:
        if node.bl_idname != "GeometryNodeGroup":
            yield node
        elif node.node_tree is not None and node.node_tree not in seen:
            yield from _node_groups(node.node_tree, seen)


MAX_CONDITION = 1e7
"""The largest ratio of scales in a matrix. Beyond it, the shortest axis is only rounding, in single precision."""


def problem(
    context: bpy.types.Context,
    low: bpy.types.Object | None,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None = None,
    method: str = Method.FLATTEN,
) -> str:
    """The first reason why these objects cannot be baked by `method`, as a sentence; empty if no reason is known.

    Fast enough for every redraw: it does not evaluate meshes.
    """
    if low is None:
        return "No low object: select the high objects, then the low one, or fill the slots."
    if not highs:
        return _object_problem(context, low, is_high=False) or _no_high(low)
    for obj in (low, *highs, *([cage] if cage else [])):
        reason = _object_problem(context, obj, is_high=obj in highs and obj != low)
        if reason:
            return reason
    twice = next((obj for number, obj in enumerate(highs) if obj in highs[:number]), None)
    if twice is not None:
        return f"{twice.name!r} is twice in the high objects: remove it once."
    if low in highs and len(highs) > 1:
        return f"{low.name!r} is both the low object and one of several high objects: remove it from the high objects."
    for obj in (low, *highs, *([cage] if cage else [])):
        needs_uv = obj == low or (obj in highs and method == Method.FLATTEN)
        reason = _mesh_problem(obj, evaluated=low not in highs, needs_uv=needs_uv)
        if reason:
            return reason
    if cage is not None and method == Method.FLATTEN:
        return f"The cage {cage.name!r} is for rays: choose the method Cast or Auto, or remove the cage."
    return ""


def low_problem(context: bpy.types.Context, low: bpy.types.Object | None, *, is_own_base: bool = False) -> str:
    """As `problem`, for work on the low object alone. is_own_base: whether its mesh is read without modifiers."""
    if low is None:
        return "No low object: select it, or fill the slot."
    return _object_problem(context, low, is_high=False) or _mesh_problem(low, evaluated=not is_own_base, needs_uv=True)


SWAPPED = "{low} has more faces than {highs}. Are they swapped?"
"""A warning if `seem_swapped`. The panel translates it."""


def seem_swapped(low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> bool:
    """Whether high and low seem swapped: the low one has more triangles. Those that modifiers and instances add need an
    evaluation, and do not count."""
    if low in highs or any(high.type != "MESH" or high.modifiers or high.mode == "SCULPT" for high in highs):
        return False
    return count_triangles(low.data) > sum(count_triangles(high.data) for high in highs)


def warnings(low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> list[str]:
    """Why the objects may be the wrong ones, in sentences."""
    names = {"low": repr(low.name), "highs": shorten_list(repr(high.name) for high in highs)}
    return [SWAPPED.format(**names)] if seem_swapped(low, highs) else []


def own_highs(low: bpy.types.Object | None) -> list[bpy.types.Object]:
    """The high objects of `low` if no others are chosen: itself, if it has modifiers that add detail, or if its active UV map
    is not the one that its materials show."""
    return [low] if low is not None and (is_added(low) or _shows_other_uvs(low)) else []


def itself(low: bpy.types.Object | None) -> list[bpy.types.Object]:
    """The high objects of `low` if no others are chosen: itself, for its materials and its shape."""
    return [low] if low is not None and low.type == "MESH" else []


def shows_own_surface(low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> bool:
    """Whether `low` is baked onto itself or another UV map of it, and no modifier adds detail to it."""
    return list(highs) == [low] and not is_added(low)


def is_itself(low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> bool:
    """As `shows_own_surface`, onto the UV map that its materials show."""
    return list(highs) == [low] and not own_highs(low)


def _no_high(low: bpy.types.Object) -> str:
    return f"No high object for {low.name!r}: select one as well."


def _object_problem(context: bpy.types.Context, obj: bpy.types.Object, *, is_high: bool) -> str:
    reason = _kind_problem(obj, is_high=is_high)
    if reason:
        return reason
    objects = context.view_layer.objects
    # A linked object may have the name of a local one, and a look-up by name finds only one of them.
    if objects.get(obj.name) != obj and obj not in objects.values():
        if obj not in context.scene.collection.all_objects.values():
            return f"{obj.name!r} is not in scene {context.scene.name!r}: link it to one of its collections."
        return ""  # its collection is excluded from the view layer; the bake checks it
    # The matrix of a hidden object is out of date; the bake checks it.
    return matrix_problem(obj) if obj.visible_get(view_layer=context.view_layer) else ""


def _kind_problem(obj: bpy.types.Object, *, is_high: bool) -> str:
    for block in (obj, obj.data):  # Blender replaces missing data with an empty object or mesh
        if block and block.is_missing:
            file = block.library.filepath
            return (
                f"{obj.name!r} is linked from {file!r}, but is not in that file: restore it, or relocate the library."
            )
    if obj.type == "MESH" or (is_high and may_show(obj)):
        return ""
    kind = obj.bl_rna.properties["type"].enum_items[obj.type].name.lower()
    if not is_high:
        return f"{obj.name!r} is of the type {kind}, which cannot be baked onto: choose a mesh, or convert it to one."
    if obj.type == "EMPTY":
        return f"{obj.name!r} is an empty that instances no collection: choose a mesh, or give it a collection."
    return f"{obj.name!r} is of the type {kind}, which has no surface to read: choose a mesh, or convert it to one."


def matrix_problem(obj: bpy.types.Object) -> str:
    """Why the object's transform cannot be baked, as a sentence; empty if it can. The dependency graph must be up to date."""
    matrix = np.array(obj.matrix_world)[:3, :3]
    if not np.isfinite(obj.matrix_world).all():
        return f"{obj.name!r} has NaN or infinite values in its transform: reset its location, rotation and scale."
    if np.linalg.cond(matrix) > MAX_CONDITION:
        return f"{obj.name!r} has zero scale on an axis: change its scale, or its parents'."
    return ""


def lacks_uvs(low: bpy.types.Object | None) -> bool:
    """Whether it is a mesh with faces and without a UV map, except those that modifiers make."""
    return low is not None and low.type == "MESH" and bool(low.data.polygons) and not low.data.uv_layers


def _mesh_problem(obj: bpy.types.Object, *, evaluated: bool, needs_uv: bool) -> str:
    # Modifiers and instances may add faces and UV layers, and in Edit Mode the mesh is out of date. The bake checks these.
    if obj.type != "MESH" or obj.data.is_editmode or (evaluated and (obj.modifiers or shows_more(obj))):
        return ""
    if not obj.data.polygons:
        return f"{obj.name!r} has no faces: choose a mesh that has some."
    if needs_uv and not obj.data.uv_layers:
        return f"{obj.name!r} has no UV layer: {UNWRAP_FIRST}."
    return ""
