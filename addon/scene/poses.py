# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds deformers that one of the objects of a bake has and another has not, by how far they move it, and mutes them.

A posed low mesh under a high one in its rest pose gets the detail of other places. What both have moves both alike, and what
moves nothing does no harm. A deformer with which the two fit better than without it is part of the shape.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from .. import older_blender
from ..core import foreach
from ..core.errors import Fix, shorten_list
from ..core.sentences import WRONG, Sentence
from ..mesh.triangles import diagonal, transformed, unit
from . import evaluation, render_view

TARGETS = {
    "HOOK": "object",
    "LATTICE": "object",
    "CURVE": "object",
    "MESH_DEFORM": "object",
    "SURFACE_DEFORM": "target",
}
"""Modifier types that move the mesh as another object says, and their property with that object."""
PLAIN = {"CAST", "LAPLACIANDEFORM", "MESH_CACHE", "MESH_SEQUENCE_CACHE", "NODES", "SIMPLE_DEFORM", "WARP"}
"""Those that move it by themselves."""
NOT_COMPARED = {
    "name",
    "type",
    "rna_type",
    "show_viewport",
    "show_render",
    "show_in_editmode",
    "show_on_cage",
    "is_active",
} | {
    *(
        "show_expanded",
        "execution_time",
        "persistent_uid",
        "use_pin_to_last",
        "use_apply_on_spline",
        "is_override_data",
    ),
}
"""Properties of modifiers that do not change what they do."""
MOVED = 1e-3
"""Of the low mesh's diagonal: about a texel of a map of 1,024. What moves less does no harm."""
MOVED_ALONG = 0.03
"""The same along the surface, for shape keys and geometry nodes of a high mesh: layers of detail move it up and down."""
BETTER = 0.2
"""The share of its movement by which a deformer has to bring high and low together to be part of the shape."""
SAMPLES = 1024
"""The points of the high meshes whose distance from the low one is compared."""
MOST_FACES = 300_000
"""Of a low mesh in that comparison, which is left out for larger ones."""


@dataclass(frozen=True)
class Deformer:
    """What moves the mesh of an object.

    Attributes:
        kind: "rig", "key" or "modifier".
        name: Of the armature object, the shape key or the modifier.
        what: What it does, equal for deformers that move two objects alike.
        type: Of a modifier.
    """

    kind: str
    name: str
    what: tuple
    type: str = ""

    @property
    def clause(self) -> str:
        """What an object is by it, for a sentence."""
        texts = {"rig": "is posed by {}", "key": "has the shape key {}", "modifier": "is moved by its modifier {}"}
        return texts[self.kind].format(repr(self.name))


@dataclass(frozen=True)
class Posed:
    """An object with deformers that others lack.

    Attributes:
        obj: The object.
    """

    obj: bpy.types.Object
    own: list[Deformer]
    others: list[bpy.types.Object]

    @property
    def sentence(self) -> Sentence:
        """What is wrong, with what fixes it."""
        verb = {"rig": "is", "key": "has it", "modifier": "is"}[self.own[0].kind]
        names = shorten_list(repr(other.name) for other in self.others)
        are = verb if len(self.others) == 1 else {"is": "are", "has it": "have it"}[verb]
        negated = f"{are} not" if verb == "is" else f"do{'es' if len(self.others) == 1 else ''} not"
        more = f" and {len(self.own) - 1} more" if len(self.own) > 1 else ""
        cause = f"{self.obj.name!r} {self.own[0].clause}{more}, {names} {negated}: they do not fit each other."
        return Fix.REST_POSE.after(Sentence(cause, WRONG, "pose"))


def notes(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object], *, for_render: bool
) -> list[str]:
    """A sentence for each object that is posed where the others are not."""
    return [posed.sentence for posed in find(context, low, highs, for_render=for_render)]


def may_differ(low: bpy.types.Object, highs: Sequence[bpy.types.Object], *, for_render: bool) -> list[Posed]:
    """The objects with deformers that others lack, whether these move anything or not. Evaluates nothing."""
    meshes = [high for high in highs if high.type == "MESH" and high != low]
    if low in highs or low.type != "MESH" or not meshes:
        return []
    pair = [low, *meshes]
    deformers = {obj: _deformers(obj, for_render) for obj in pair}
    has = {obj: _all_of(obj, deformers, pair) for obj in pair}
    posed_objects = []
    for obj in pair:
        others = meshes if obj == low else [low]
        own = [
            each
            for each in deformers[obj]
            if not _follows(each, pair) and any(each.what not in has[one] for one in others)
        ]
        lacking = [one for one in others if any(each.what not in has[one] for each in own)]
        if own:
            posed_objects.append(Posed(obj, own, lacking))
    return posed_objects


def find(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object], *, for_render: bool
) -> list[Posed]:
    """The objects that are moved by deformers which others lack, farther than does no harm.

    Nothing is measured while Blender renders, which must not see the copies, and in a linked scene, which takes none.
    """
    suspects = may_differ(low, highs, for_render=for_render)
    if not suspects or render_view.is_busy() or not context.scene.is_editable:
        return []
    meshes = [high for high in highs if high.type == "MESH"]
    with _copies(context, [low, *meshes], suspects, for_render) as copies:
        before = {obj: copies.points(obj) for obj in (low, *meshes)}
        copies.mute()
        after = {obj: copies.points(obj) for obj in (low, *meshes)}
        is_whole = all(len(places[low]) == len(low.data.vertices) for places in (before, after))  # nodes may cut it
        faces = _faces(low) if is_whole and len(low.data.polygons) <= MOST_FACES else None
        normals = {posed.obj: copies.normals(posed.obj) for posed in suspects}
    size = diagonal(before[low])
    differing, farthest = [], 0.0
    for posed in suspects:
        if before[posed.obj].shape != after[posed.obj].shape:  # its nodes make another mesh
            continue
        ways, least = before[posed.obj] - after[posed.obj], MOVED * size
        far = np.linalg.norm(ways, axis=1)
        if posed.obj != low and all(each.kind == "key" or each.type == "NODES" for each in posed.own):
            up = normals[posed.obj]
            ways, least = ways - up * (ways * up).sum(axis=1, keepdims=True), MOVED_ALONG * size
        if np.linalg.norm(ways, axis=1).max(initial=0.0) > least:
            differing.append(posed)
            farthest = max(farthest, float(far[far > MOVED * size].mean()))
    if differing and faces is not None and _gain(low, meshes, before, after, faces) < -BETTER * farthest:
        return []
    return differing


@contextmanager
def at_rest(
    context: bpy.types.Context, low: bpy.types.Object, highs: Sequence[bpy.types.Object], *, for_render: bool
) -> Iterator[None]:
    """Mute the deformers that `find` finds, and put rigs into their rest pose, until the block ends. Raises BakeError while
    Blender renders."""
    if may_differ(low, highs, for_render=for_render):
        render_view.check_free()
    with ExitStack() as restore:
        for posed in find(context, low, highs, for_render=for_render):
            for deformer in posed.own:
                _mute(posed.obj, deformer, restore)
        context.view_layer.update()
        yield
    context.view_layer.update()


def _mute(obj: bpy.types.Object, deformer: Deformer, restore: ExitStack) -> None:
    if deformer.kind == "rig":
        rig = next(each for each in bpy.data.objects if each.session_uid == deformer.what[1])
        evaluation.set_until(rig.data, "pose_position", "REST", restore)
    elif deformer.kind == "key":
        evaluation.set_until(obj.data.shape_keys.key_blocks[deformer.name], "mute", True, restore)
    else:
        modifier = obj.modifiers[deformer.name]
        evaluation.set_until(modifier, "show_viewport", False, restore)
        evaluation.set_until(modifier, "show_render", False, restore)


def _deformers(obj: bpy.types.Object, for_render: bool) -> list[Deformer]:
    deformers = [_of_rig(rig) for rig in dict.fromkeys(rigs(obj, for_render)) if rig.data.pose_position == "POSE"]
    keys = obj.data.shape_keys
    for key in keys.key_blocks[1:] if keys is not None else ():
        if key.value and not key.mute:
            deformers.append(Deformer("key", key.name, ("KEY", key.name, round(key.value, 4))))
    for modifier in obj.modifiers:
        if modifier.type in (*TARGETS, *PLAIN) and (modifier.show_render if for_render else modifier.show_viewport):
            deformers.append(Deformer("modifier", modifier.name, _what(modifier), modifier.type))
    return deformers


def _of_rig(rig: bpy.types.Object) -> Deformer:
    return Deformer("rig", rig.name, ("RIG", rig.session_uid))


def rigs(obj: bpy.types.Object, for_render: bool) -> Iterator[bpy.types.Object]:
    """The armature objects whose poses move an object or its mesh."""
    for modifier in obj.modifiers:
        if modifier.type == "ARMATURE" and (modifier.show_render if for_render else modifier.show_viewport):
            yield from filter(None, [modifier.object])
    above = obj
    while above is not None:
        if above.parent is not None and above.parent.type == "ARMATURE" and above.parent_type in {"BONE", "ARMATURE"}:
            yield above.parent
        for constraint in above.constraints:
            if constraint.mute or not constraint.influence:
                continue
            targets = constraint.targets if constraint.type == "ARMATURE" else [constraint]
            for each in targets:
                target = getattr(each, "target", None)
                if target is not None and target.type == "ARMATURE" and getattr(each, "subtarget", ""):
                    yield target
        above = above.parent


def _what(modifier: bpy.types.Modifier) -> tuple:
    """The type and the settings of a modifier, in such a way that equal ones do the same."""
    if modifier.type in TARGETS:
        return modifier.type, _value(getattr(modifier, TARGETS[modifier.type]))
    if modifier.type == "NODES":
        return modifier.type, _value(modifier.node_group), *_inputs(modifier)
    names = [each.identifier for each in modifier.bl_rna.properties if each.type != "COLLECTION"]
    return modifier.type, *((name, _value(getattr(modifier, name))) for name in names if name not in NOT_COMPARED)


def _inputs(modifier: bpy.types.Modifier) -> Iterator[object]:
    """The values of the inputs of a modifier's nodes."""
    items = modifier.node_group.interface.items_tree if modifier.node_group is not None else ()
    for item in items:
        if item.item_type == "SOCKET" and item.in_out == "INPUT":
            yield _value(older_blender.modifier_input(modifier, item.identifier))


def _value(value: object) -> object:
    if isinstance(value, bpy.types.ID):
        return value.session_uid
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else str(value)


def _follows(deformer: Deformer, pair: Sequence[bpy.types.Object]) -> bool:
    """Whether an object is moved by another one of the pair: then it is where that is."""
    return deformer.type in TARGETS and deformer.what[1] in {obj.session_uid for obj in pair}


def _all_of(
    obj: bpy.types.Object, deformers: dict[bpy.types.Object, list[Deformer]], pair: Sequence[bpy.types.Object]
) -> set[tuple]:
    """What moves an object, also by way of another one of the pair."""
    poses = {each.what for each in deformers[obj]}
    for each in deformers[obj]:
        if _follows(each, pair):
            target = next(other for other in pair if other.session_uid == each.what[1])
            poses |= {other.what for other in deformers[target]} if target != obj else set()
    return poses


class _Copies:
    """Copies of objects with their deformers alone, whose vertices are those of the meshes."""

    def __init__(self, context: bpy.types.Context, suspects: Sequence[Posed], restore: ExitStack):
        self._context, self._suspects, self._restore = context, suspects, restore
        self.of: dict[bpy.types.Object, bpy.types.Object] = {}

    def add(self, obj: bpy.types.Object, for_render: bool) -> None:
        copy = self.of[obj] = obj.copy()
        own = next((posed.own for posed in self._suspects if posed.obj == obj), [])
        if any(each.kind == "key" for each in own):  # muting one changes the mesh
            copy.data = obj.data.copy()
            self._restore.callback(bpy.data.meshes.remove, copy.data)
        self._restore.callback(bpy.data.objects.remove, copy)
        copy.hide_viewport = copy.hide_render = False
        for modifier in list(copy.modifiers):
            is_shown = modifier.show_render if for_render else modifier.show_viewport
            if modifier.type in ("ARMATURE", *TARGETS, *PLAIN) and is_shown:
                modifier.show_viewport = True
            else:
                copy.modifiers.remove(modifier)
        self._context.scene.collection.objects.link(copy)

    def mute(self) -> None:
        """Mute the deformers that others lack, and put their rigs into the rest pose."""
        for posed in self._suspects:
            for deformer in posed.own:
                _mute(self.of[posed.obj], deformer, self._restore)
        self._context.view_layer.update()

    def points(self, obj: bpy.types.Object) -> np.ndarray:
        """The places (V, 3) float64 of the vertices of an object, in the world."""
        data, matrix = self._shown(obj)
        positions = foreach.vectors(data.vertices, "co")
        return transformed(positions, matrix)

    def normals(self, obj: bpy.types.Object) -> np.ndarray:
        """The unit normals (V, 3) float64 of the vertices of an object, in the world."""
        data, matrix = self._shown(obj)
        directions = foreach.vectors(data.vertex_normals)
        return unit(directions @ np.linalg.pinv(matrix[:3, :3]))

    def _shown(self, obj: bpy.types.Object) -> tuple[bpy.types.Mesh, np.ndarray]:
        """The mesh of an object with its deformers, and its matrix (4, 4) float64."""
        shown = self.of.get(obj, obj).evaluated_get(self._context.evaluated_depsgraph_get())
        return shown.data if obj in self.of else obj.data, np.array(shown.matrix_world, np.float64)


@contextmanager
def _copies(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], suspects: Sequence[Posed], for_render: bool
) -> Iterator[_Copies]:
    with ExitStack() as restore:
        copies = _Copies(context, suspects, restore)
        for obj in objects:
            if _deformers(obj, for_render):
                copies.add(obj, for_render)
        context.view_layer.update()
        yield copies
    context.view_layer.update()


def _faces(low: bpy.types.Object) -> list[tuple[int, ...]]:
    return [tuple(face.vertices) for face in low.data.polygons]


def _gain(
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    before: dict[bpy.types.Object, np.ndarray],
    after: dict[bpy.types.Object, np.ndarray],
    faces: list[tuple[int, ...]],
) -> float:
    """How much nearer the low surface is to points of the high meshes after deformers were muted, where this changes; 0 if it
    changes nowhere."""
    far = []
    for places in (before, after):
        tree = BVHTree.FromPolygons(places[low].tolist(), faces)
        each = max(1, SAMPLES // len(highs))
        points = [point for high in highs for point in places[high][:: max(1, len(places[high]) // each)].tolist()]
        far.append(
            np.array([distance if distance is not None else 0.0 for *_, distance in map(tree.find_nearest, points)])
        )
    if far[0].shape != far[1].shape:
        return 0.0
    change = far[0] - far[1]
    is_changed = np.abs(change) > 1e-3 * max(1e-30, float(np.abs(change).max(initial=0.0)))
    return float(change[is_changed].mean()) if is_changed.any() else 0.0
