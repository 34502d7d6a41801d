# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives low meshes the armature, the vertex groups and the shape keys of the objects that they stand for.

Low meshes are made of these objects at rest: in the rest pose, without shape keys. Weights, and by how much shape keys move a
vertex, are carried to them as mesh/transfer.py does.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial

import bpy
import numpy as np
from mathutils import Matrix

from ...core.declarations.choices import Modifiers
from ...core.errors import shorten_list
from ...core.progress import Progress, Task
from ...core.sentences import LOOK, NOTE, Sentence
from ...mesh.transfer import OnLow
from ...scene import evaluation, mesh_reader, poses
from ...scene.object_checks import ObjectRef
from . import bent_poses, shape_keys, skin_weights
from .skin_weights import Found

OF_MODIFIER = (
    *("use_deform_preserve_volume", "use_vertex_groups", "use_bone_envelopes", "use_multi_modifier", "vertex_group"),
    *("invert_vertex_group", "show_viewport", "show_render", "show_in_editmode", "show_on_cage"),
)
"""The properties of an Armature modifier that its copies have."""
KINDS = {"OBJECT", "ARMATURE", "BONE"}
"""Of parents that low objects have, too."""


@dataclass(frozen=True)
class Skin:
    """What deforms objects that one low mesh stands for.

    Attributes:
        refs: The objects.
        rigs: The armature objects that move them.
        modifiers: Which modifiers are shown, as in the settings.
        layers: The names of shape keys that are part of the shape.
        muted: Those of shape keys that are muted also without `at_rest`.
        lows: The low objects that `carry` has given shape keys; they are at rest, too, as long as the objects are.
    """

    refs: tuple[ObjectRef, ...]
    rigs: tuple[ObjectRef, ...]
    modifiers: str
    layers: frozenset[str]
    muted: frozenset[str]
    lows: list[ObjectRef] = field(default_factory=list)

    @classmethod
    def of(cls, objects: Sequence[bpy.types.Object], modifiers: str) -> "Skin":
        """What deforms some objects."""
        for_render = modifiers == Modifiers.RENDER
        rigs = dict.fromkeys(rig for obj in objects for rig in poses.rigs(obj, for_render))
        layers = frozenset(name for obj in objects for name in shape_keys.layers(obj))
        muted = frozenset(key.name for obj in objects for key in shape_keys.keys_of(obj) if key.mute)
        return cls(tuple(map(ObjectRef.of, objects)), tuple(map(ObjectRef.of, rigs)), modifiers, layers, muted)

    @property
    def notes(self) -> list[Sentence]:
        """What low meshes cannot have, in sentences."""
        if len(self.rigs) > 1:
            names = shorten_list(repr(rig.name) for rig in self.rigs)
            return [
                Sentence(
                    f"{self.refs[0].name!r} and what belongs to it are moved by {len(self.rigs)} armatures, {names}: the low "
                    "mesh has no skin and no shape keys. Join the armatures, or make an asset for each.",
                    LOOK,
                )
            ]
        if not self.layers:
            return []
        names = shorten_list(map(repr, sorted(self.layers)))
        text = f"Shape keys that only move the surface up and down, as layers of detail do, are part of the low mesh: {names}. "
        return [Sentence(text + "Set them to 0 to have them as its shape keys.", NOTE)]

    @contextmanager
    def at_rest(self, context: bpy.types.Context, others: Sequence[bpy.types.Object] = ()) -> Iterator[None]:
        """Put the objects into their rest pose, without shape keys, until the block ends. others: without theirs, too."""
        if len(self.rigs) > 1:
            yield
            return
        with ExitStack() as restore:
            for ref in self.rigs:
                before = ref.resolve().data.pose_position
                if before != "REST":
                    ref.resolve().data.pose_position = "REST"
                    restore.callback(_set_pose_position, ref, before)
            for ref in (*self.refs, *map(ObjectRef.of, others)):
                keys = shape_keys.keys_of(ref.resolve())
                names = [key.name for key in keys if key.name not in self.layers and not key.mute]
                shape_keys.mute(ref, names, True)
                restore.callback(shape_keys.mute, ref, names, False)
            restore.callback(self._end_rest)
            context.view_layer.update()
            yield
        context.view_layer.update()

    def _end_rest(self) -> None:
        for ref in self.lows:
            low = ref.find()
            keys = shape_keys.keys_of(low) if low is not None else ()
            shape_keys.mute(ref, [key.name for key in keys if key.name not in self.muted], False)

    def motions(
        self, context: bpy.types.Context, points: np.ndarray, triangles: np.ndarray, origin: np.ndarray
    ) -> Task[np.ndarray | None]:
        """To where poses move the vertices of a surface near the objects, while they are `at_rest`.

        Args:
            context: of the scene.
            points: (V, 3), relative to the origin.
            triangles: (T, 3) int.
            origin: (3,), in world space.

        Returns:
            Matrices (P, V, 3, 4), relative to the origin, as CollapseOptions has them; None for objects that nothing moves.
        """
        if len(self.rigs) > 1 or not (self.rigs or self._keys):
            return None
        highs = [ref.resolve() for ref in self.refs]
        look = partial(evaluation.evaluate, context, highs, modifiers=self.modifiers)
        yield Progress("Reading weights", 0.0)
        found = look(partial(skin_weights.find, highs, partial(skin_weights.of_points, points + origin, triangles)))
        if found is None:
            return None
        offsets, _ = yield from shape_keys.offsets_of(look, highs, found, self._keys)
        (place,), is_bone = found.places, self._is_bone(found)
        weights = place.mixed(skin_weights.normalized(found.weights, is_bone))[:, is_bone]
        names = [name for name, is_one in zip(found.groups, is_bone, strict=True) if is_one]
        turns = bent_poses.turns(self._rig, names, origin)
        return bent_poses.motions(weights, turns, [place.mixed(offset) for offset in offsets.values()])

    def carry(self, context: bpy.types.Context, lows: Sequence[bpy.types.Object]) -> Task[list[Sentence]]:
        """Give low objects, which lie at the surface of the objects, what deforms these, while they are `at_rest`.

        Returns sentences of what low objects cannot have.
        """
        if not lows:  # nothing was made that could lack anything
            return []
        if len(self.rigs) > 1:
            return self.notes
        highs, notes, found = [ref.resolve() for ref in self.refs], [], None
        look = partial(evaluation.evaluate, context, highs, modifiers=self.modifiers)
        if self._keys or self.rigs or any(high.vertex_groups for high in highs):
            yield Progress("Reading weights", 0.0)
            found = look(partial(skin_weights.find, highs, partial(skin_weights.of_lows, lows)))
        if found is not None:
            offsets, notes = yield from shape_keys.offsets_of(look, highs, found, self._keys)
            for low, place in zip(lows, found.places, strict=True):
                self._weigh(low, found, place, highs)
                shape_keys.add(low, {name: place.fitted(offset) for name, offset in offsets.items()}, highs)
                self.lows.append(ObjectRef.of(low))
                shape_keys.mute(self.lows[-1], offsets, True)
        for low in lows:
            self._attach(low, highs)
            if low.modifiers or shape_keys.keys_of(low):
                _fix_normals(low.data)
        context.view_layer.update()
        return [*self.notes, *notes]

    @property
    def _rig(self) -> bpy.types.Object | None:
        return self.rigs[0].resolve() if self.rigs else None

    @property
    def _keys(self) -> list[str]:
        """The names of the shape keys that low objects get."""
        keys = [key.name for ref in self.refs for key in shape_keys.keys_of(ref.resolve())]
        return [name for name in dict.fromkeys(keys) if name not in self.layers]

    def _is_bone(self, found: Found) -> np.ndarray:
        """Which vertex groups (G,) bool are of bones that deform."""
        rig = self._rig
        bones = {bone.name for bone in rig.data.bones if bone.use_deform} if rig is not None else set()
        return np.array([name in bones for name in found.groups], bool)

    def _weigh(self, low: bpy.types.Object, found: Found, place: OnLow, highs: Sequence[bpy.types.Object]) -> None:
        """Give a low object the vertex groups."""
        is_bone = self._is_bone(found)
        weights = skin_weights.limited(place.fitted(skin_weights.normalized(found.weights, is_bone)), is_bone)
        low.vertex_groups.clear()
        for name, of_group in zip(found.groups, weights.T, strict=True):
            group = low.vertex_groups.new(name=name)
            for value in np.unique(of_group[of_group > 0.0]).tolist():  # Blender takes one weight at a time
                group.add(np.flatnonzero(of_group == value).tolist(), value, "REPLACE")
            group.lock_weight = any(
                high.vertex_groups[name].lock_weight for high in highs if name in high.vertex_groups
            )

    def _attach(self, low: bpy.types.Object, highs: Sequence[bpy.types.Object]) -> None:
        """Give a low object the Armature modifiers and the parent."""
        rig, for_render = self._rig, self.modifiers == Modifiers.RENDER
        armed = next((high for high in highs if rig is not None and _is_skinned(high, for_render)), None)
        if armed is not None:
            sources = _armature_modifiers(armed, for_render)
            names = [source.name for source in sources] or ["Armature"]
            for number, name in enumerate(names):
                made = low.modifiers.new(name, "ARMATURE")
                made.object = rig
                for each in OF_MODIFIER if sources else ():
                    setattr(made, each, getattr(sources[number], each))
                low.modifiers.move(len(low.modifiers) - 1, number)
        above = highs[0]
        while above.parent in highs:
            above = above.parent
        parent, is_bone = above.parent, above.parent_type == "BONE" and armed is None
        if parent is not None and above.parent_type in KINDS:
            _put_below(low, parent, above.parent_bone if is_bone else "")


def put_in_place_of(obj: bpy.types.Object, other: bpy.types.Object) -> None:
    """Put an object where another one is, below the same parent."""
    obj.matrix_world = other.matrix_world
    if other.parent is not None and other.parent_type in KINDS:
        _put_below(obj, other.parent, other.parent_bone if other.parent_type == "BONE" else "")


def _put_below(obj: bpy.types.Object, parent: bpy.types.Object, bone: str) -> None:
    """Give an object a parent without moving it. bone: its name, where the parent is one.

    The inverse of the parent's matrix has what a place, a turn and a scale cannot have: what is turned below a parent of
    uneven scale is sheared.
    """
    before = obj.matrix_world.copy()
    obj.parent, obj.parent_type, obj.parent_bone = parent, "BONE" if bone else "OBJECT", bone
    obj.matrix_parent_inverse, obj.matrix_basis = Matrix(), Matrix()
    bpy.context.view_layer.update()
    of_parent = obj.matrix_world.copy()
    obj.matrix_basis = before
    obj.matrix_parent_inverse = of_parent.inverted_safe() @ before @ obj.matrix_basis.inverted_safe()
    bpy.context.view_layer.update()


def _armature_modifiers(obj: bpy.types.Object, for_render: bool) -> list[bpy.types.ArmatureModifier]:
    return [
        modifier
        for modifier in obj.modifiers
        if modifier.type == "ARMATURE" and modifier.object is not None
        if (modifier.show_render if for_render else modifier.show_viewport)
    ]


def _is_skinned(obj: bpy.types.Object, for_render: bool) -> bool:
    """Whether an armature deforms the mesh of an object."""
    if _armature_modifiers(obj, for_render):
        return True
    return obj.parent is not None and obj.parent.type == "ARMATURE" and obj.parent_type == "ARMATURE"


def _fix_normals(data: bpy.types.Mesh) -> None:
    """Store custom normals against those of the faces, so that they follow a pose: plain vectors stay as they are."""
    own = data.attributes.get("custom_normal")
    if own is not None and own.data_type == "FLOAT_VECTOR":
        normals = mesh_reader.corner_normals(data)
        data.attributes.remove(own)
        data.normals_split_custom_set(normals)


def _set_pose_position(ref: ObjectRef, value: str) -> None:
    rig = ref.find()
    if rig is not None:
        rig.data.pose_position = value
