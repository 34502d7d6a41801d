# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives low meshes the armature, the vertex groups and the shape keys of the objects that they stand for.

Low meshes are made of these objects at rest: in the rest pose, without shape keys. Weights, and by how much shape keys move a
vertex, come from the nearest place on them, and then are those that differ least, between vertices too, from samples of the
objects: the L2 projection of finite elements, solved by conjugate gradients (Hestenes and Stiefel, 1952). On spot with five
bones and 500 to 2,000 triangles that takes 25 to 33 % of what weights add to the shading error of a pose.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import bpy
import numpy as np

from ...core import foreach
from ...core.declarations.choices import Modifiers
from ...core.errors import shorten_list
from ...core.progress import Progress, Task
from ...core.sentences import LOOK, NOTE, Sentence
from ...mesh.closest import Surface
from ...mesh.fitting import SAME_SIDE_COSINE, Samples, surface_samples
from ...mesh.topology import sums_of
from ...mesh.triangles import barycentric, transformed, unit, unit_normals, vertex_normals
from ...scene import evaluation, mesh_reader, object_checks, poses
from ...scene.object_checks import ObjectRef

MOST_BONES = 4
"""The bones that move a vertex at most: engines read no more."""
OF_MODIFIER = (
    *("use_deform_preserve_volume", "use_vertex_groups", "use_bone_envelopes", "use_multi_modifier", "vertex_group"),
    *("invert_vertex_group", "show_viewport", "show_render", "show_in_editmode", "show_on_cage"),
)
"""The properties of an Armature modifier that its copies have."""
SAMPLES, SAMPLES_PER_VERTEX = 20_000, 8
"""The samples of the objects, at least and for each vertex of a low mesh."""
LEAST = 1e-4
"""The weight of a bone from which it moves a vertex."""
PULL = 0.02
"""How much values at the nearest place count, against those of samples."""
STEPS = 40
"""Of conjugate gradients, at most."""
ALONG = 0.1
"""The share of a shape key's squared movement that may lie along the surface if it is a layer of detail."""
OF_KEY = "slider_min", "slider_max", "value", "interpolation"
"""Those of a shape key."""


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
        layers = frozenset(name for obj in objects for name in _layers(obj))
        muted = frozenset(key.name for obj in objects for key in _keys(obj) if key.mute)
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
        text = f"{names} only move the surface up and down, as layers of detail do: these shape keys are part of the low mesh. "
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
                names = [key.name for key in _keys(ref.resolve()) if key.name not in self.layers and not key.mute]
                _mute(ref, names, True)
                restore.callback(_mute, ref, names, False)
            restore.callback(self._end_rest)
            context.view_layer.update()
            yield
        context.view_layer.update()

    def _end_rest(self) -> None:
        for ref in self.lows:
            low = ref.find()
            _mute(ref, [key.name for key in _keys(low) if key.name not in self.muted] if low is not None else (), False)

    def carry(self, context: bpy.types.Context, lows: Sequence[bpy.types.Object]) -> Task[list[Sentence]]:
        """Give low objects, which lie at the surface of the objects, what deforms these, while they are `at_rest`.

        Returns sentences of what low objects cannot have.
        """
        if len(self.rigs) > 1 or not lows:
            return self.notes
        highs, notes, found = [ref.resolve() for ref in self.refs], [], None
        keys = list(dict.fromkeys(key.name for high in highs for key in _keys(high) if key.name not in self.layers))
        look = partial(evaluation.evaluate, context, highs, modifiers=self.modifiers)
        if keys or self.rigs or any(high.vertex_groups for high in highs):
            yield Progress("Reading weights", 0.0)
            found = look(partial(_found, highs, lows))
        if found is not None:
            offsets, notes = yield from _offsets(look, highs, found, keys)
            for low, place in zip(lows, found.lows, strict=True):
                self._weigh(low, found, place, highs)
                _add_keys(low, {name: place.fitted(offset) for name, offset in offsets.items()}, highs)
                self.lows.append(ObjectRef.of(low))
                _mute(self.lows[-1], offsets, True)
        for low in lows:
            self._attach(low, highs)
            if low.modifiers or _keys(low):
                _fix_normals(low.data)
        context.view_layer.update()
        return [*self.notes, *notes]

    @property
    def _rig(self) -> bpy.types.Object | None:
        return self.rigs[0].resolve() if self.rigs else None

    def _weigh(
        self, low: bpy.types.Object, found: "_Found", place: "_OnLow", highs: Sequence[bpy.types.Object]
    ) -> None:
        """Give a low object the vertex groups."""
        rig = self._rig
        bones = {bone.name for bone in rig.data.bones if bone.use_deform} if rig is not None else set()
        is_bone = np.array([name in bones for name in found.groups], bool)
        weights = limited(place.fitted(normalized(found.weights, is_bone)), is_bone)
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
        if parent is None or above.parent_type not in {"OBJECT", "ARMATURE", "BONE"}:
            return
        before = low.matrix_world.copy()
        low.parent, low.parent_type = parent, "BONE" if is_bone else "OBJECT"
        low.parent_bone = above.parent_bone if is_bone else ""
        bpy.context.view_layer.update()
        low.matrix_world = before


@dataclass(frozen=True)
class _Places:
    """Places on the objects.

    Attributes:
        corners: (N, 3) int, the triangles: vertices of the objects, then rows of what is read of them.
        shares: (N, 3), barycentric coordinates on them.
    """

    corners: np.ndarray
    shares: np.ndarray

    def mixed(self, values: np.ndarray) -> np.ndarray:
        """The values (N, C) there of values (R, C) of the rows."""
        return sum(self.shares[:, corner, None] * values[self.corners[:, corner]] for corner in range(3))

    def within(self, read: np.ndarray) -> "_Places":
        """With rows in place of vertices. read (R,) int: their vertices, sorted."""
        return replace(self, corners=np.searchsorted(read, self.corners))


@dataclass(frozen=True)
class _OnLow:
    """Where a low mesh and samples of the objects lie on each other.

    Attributes:
        vertices: The places of its vertices on the objects.
        samples: The places of the samples on the objects.
        triangles: (T, 3) int, its own.
        nearest: (N,) int, which of them each sample is on.
        shares: (N, 3), barycentric coordinates there.
    """

    vertices: _Places
    samples: _Places
    triangles: np.ndarray
    nearest: np.ndarray
    shares: np.ndarray

    def within(self, read: np.ndarray) -> "_OnLow":
        """As _Places.within."""
        return replace(self, vertices=self.vertices.within(read), samples=self.samples.within(read))

    def fitted(self, values: np.ndarray) -> np.ndarray:
        """The values (V, C) of the vertices that come nearest to values (R, C) of the rows."""
        start = self.vertices.mixed(values)
        if not start.size:
            return start
        missing = self.samples.mixed(values) - _Places(self.triangles[self.nearest], self.shares).mixed(start)
        return start + projected(missing, self.triangles, self.nearest, self.shares, len(start))


@dataclass(frozen=True)
class _Found:
    """What is read of the objects, at the vertices around the places.

    Attributes:
        rows: Of each object, the vertices (n,) int that have a row.
        counts: Of each object, its vertices.
        lows: Of each low mesh, where it lies.
        groups: The names of the vertex groups.
        weights: (N, G), the weights.
    """

    rows: list[np.ndarray]
    counts: list[int]
    lows: list[_OnLow]
    groups: list[str] = field(default_factory=list)
    weights: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


def normalized(weights: np.ndarray, is_bone: np.ndarray) -> np.ndarray:
    """Weights (N, G), those of bones (G,) bool over their sum, as Blender deforms by them."""
    sums = weights[:, is_bone].sum(axis=1, keepdims=True)
    return np.where(is_bone, weights / np.where(sums > 0.0, sums, 1.0), weights)


def limited(weights: np.ndarray, is_bone: np.ndarray) -> np.ndarray:
    """Weights (V, G) from 0 to 1, of bones (G,) bool the MOST_BONES greatest, with a sum of 1.

    A vertex that moves with bones by less than a half moves with none.
    """
    result = np.clip(weights, 0.0, 1.0)
    of_bones = result[:, is_bone]
    is_moved = of_bones.sum(axis=1, keepdims=True) >= 0.5
    if of_bones.shape[1] > MOST_BONES:
        order = np.argsort(-of_bones, axis=1, kind="stable")
        np.put_along_axis(of_bones, order[:, MOST_BONES:], 0.0, axis=1)
    of_bones[of_bones < LEAST] = 0.0
    sums = of_bones.sum(axis=1, keepdims=True)
    result[:, is_bone] = np.where(is_moved, of_bones / np.where(sums > 0.0, sums, 1.0), 0.0)
    return result


def projected(
    missing: np.ndarray, triangles: np.ndarray, nearest: np.ndarray, shares: np.ndarray, count: int
) -> np.ndarray:
    """Values (V, C) of vertices whose mix at samples on the triangles comes nearest to values there.

    Args:
        missing: (N, C), of the samples.
        triangles: (T, 3) int.
        nearest: (N,) int, the triangle of each sample.
        shares: (N, 3), barycentric coordinates there.
        count: of the vertices, V.
    """
    products = sums_of(nearest, (shares[:, :, None] * shares[:, None]).reshape(-1, 9), len(triangles)).reshape(-1, 3, 3)
    weight = PULL * max(1, len(nearest)) / count

    def gathered(values: np.ndarray) -> np.ndarray:
        return sums_of(triangles.reshape(-1), values.reshape(3 * len(triangles), -1), count)

    pulls = np.stack(
        [sums_of(nearest, shares[:, corner, None] * missing, len(triangles)) for corner in range(3)], axis=1
    )
    rest = gathered(pulls)
    result, along, power = np.zeros_like(rest), rest, (rest * rest).sum(axis=0)
    enough = 1e-8 * np.maximum(power, 1e-300)
    for _ in range(STEPS):
        if (power <= enough).all():
            break
        image = gathered(products @ along[triangles]) + weight * along
        share = power / np.maximum((along * image).sum(axis=0), 1e-300)
        result, rest = result + share * along, rest - share * image
        before, power = power, (rest * rest).sum(axis=0)
        along = rest + power / np.maximum(before, 1e-300) * along
    return result


def nearest_places(
    points: np.ndarray, triangles: np.ndarray, places: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The nearest triangle of each place that does not look the other way, and where it is on that.

    Args:
        points: (P, 3), of the surface.
        triangles: (T, 3) int.
        places: (N, 3).
        normals: (N, 3), of unit length, at the places.

    Returns:
        The triangles (N,) int, and barycentric coordinates (N, 3). Where all look the other way, it is the nearest one.
    """
    origin = places.mean(axis=0)
    near, here = (points - origin).astype(np.float32), (places - origin).astype(np.float32)
    faces, _ = unit_normals(near, triangles, np.float64)
    found, where, _ = Surface(near, triangles).closest(here)
    is_turned = (faces[found] * normals).sum(axis=1) < 0.0
    axes = np.abs(normals).argmax(axis=1)
    signs = np.take_along_axis(normals, axes[:, None], axis=1)[:, 0] < 0.0
    for axis, sign in ((axis, sign) for axis in range(3) for sign in (False, True)):
        left = np.flatnonzero(is_turned & (axes == axis) & (signs == sign))
        candidates = np.flatnonzero((faces[:, axis] < 0.0) if sign else (faces[:, axis] > 0.0))
        if len(left) and len(candidates):
            again, place, _ = Surface(near, triangles[candidates]).closest(here[left])
            found[left], where[left] = candidates[again], place
    return found, barycentric(where.astype(np.float64), near[triangles[found]].astype(np.float64))


def _found(
    highs: Sequence[bpy.types.Object], lows: Sequence[bpy.types.Object], depsgraph: bpy.types.Depsgraph
) -> _Found | None:
    """The places of low meshes, and the weights around them; None if instances alone have a surface."""
    points, triangles, counts = [], [], []
    for high in highs:
        shown, corners = np.zeros((0, 3)), np.zeros((0, 3), int)
        if object_checks.shows_itself(high, for_render=depsgraph.mode == "RENDER"):
            with mesh_reader.evaluated(high, depsgraph) as data:
                matrix = mesh_reader.matrix(high.evaluated_get(depsgraph))
                shown = transformed(mesh_reader.points(data).astype(np.float64), matrix)
                corners = _outwards(mesh_reader.corner_vertices(data)[mesh_reader.triangles(data)], matrix)
                is_finite = np.isfinite(shown).all(axis=1)
                corners = corners[is_finite[corners].all(axis=1)]
                shown[~is_finite] = 0.0
        points.append(shown)
        triangles.append(corners + sum(counts))
        counts.append(len(shown))
    points, triangles = np.concatenate(points), np.concatenate(triangles)
    if not len(triangles):
        return None
    samples = surface_samples(
        points, triangles, max(SAMPLES, SAMPLES_PER_VERTEX * max(len(low.data.vertices) for low in lows))
    )
    on_lows = [_on_low(low, points, triangles, samples) for low in lows]
    read = np.unique(
        np.concatenate([part.corners.reshape(-1) for each in on_lows for part in (each.vertices, each.samples)])
    )
    starts = np.cumsum([0, *counts])
    rows = [read[(read >= first) & (read < end)] - first for first, end in zip(starts[:-1], starts[1:], strict=True)]
    names, weights = _weights(highs, rows, depsgraph)
    return _Found(rows, counts, [each.within(read) for each in on_lows], names, weights)


def _on_low(low: bpy.types.Object, points: np.ndarray, triangles: np.ndarray, samples: Samples) -> _OnLow:
    """How a low mesh lies on objects. points (P, 3), triangles (T, 3) int: of these, in world space, as the samples."""
    matrix, corners = mesh_reader.matrix(low), mesh_reader.corner_vertices(low.data)[mesh_reader.triangles(low.data)]
    places, corners = transformed(mesh_reader.points(low.data).astype(np.float64), matrix), _outwards(corners, matrix)
    found, shares = nearest_places(points, triangles, places, vertex_normals(places, corners))
    normals, _ = unit_normals(places, corners)
    nearest, on_them = nearest_places(places, corners, samples.points, samples.normals)
    ways = np.einsum("nc,ncx->nx", on_them, places[corners[nearest]]) - samples.points
    sides = np.linalg.norm(places[corners] - places[np.roll(corners, 1, axis=1)], axis=2)
    is_on = ((normals[nearest] * samples.normals).sum(axis=1) > SAME_SIDE_COSINE) & (
        np.linalg.norm(ways, axis=1) < sides.mean()  # what is farther is not part of the low mesh
    )
    kept = samples.chosen(is_on)
    on_objects = _Places(
        triangles[kept.triangles], barycentric(kept.points, points[triangles[kept.triangles]].astype(np.float64))
    )
    return _OnLow(_Places(triangles[found], shares), on_objects, corners, nearest[is_on], on_them[is_on])


def _outwards(triangles: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Triangles (T, 3) whose normals in the world are those that Blender shows, also of an object that a matrix mirrors."""
    return triangles[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else triangles


def _weights(
    highs: Sequence[bpy.types.Object], rows: Sequence[np.ndarray], depsgraph: bpy.types.Depsgraph
) -> tuple[list[str], np.ndarray]:
    """The names of the vertex groups, and the weights (N, G) of some vertices of each object. An object whose parent is a bone
    belongs to that alone."""
    numbers: dict[str, int] = {}
    found = []
    first = 0
    for high, which in zip(highs, rows, strict=True):
        if high.parent_type == "BONE":
            number = numbers.setdefault(high.parent_bone, len(numbers))
            found += [(first + row, number, 1.0) for row in range(len(which))]
        elif high.type == "MESH":
            names = [group.name for group in high.evaluated_get(depsgraph).vertex_groups]
            own = [numbers.setdefault(name, len(numbers)) for name in names]
            with mesh_reader.evaluated(high, depsgraph) as data:
                # Blender gives the weights of vertices one by one alone.
                found += [
                    (first + row, own[one.group], one.weight)
                    for row, vertex in enumerate(which.tolist())
                    for one in data.vertices[vertex].groups
                ]
        first += len(which)
    weights = np.zeros((first, len(numbers)))
    vertices, groups, values = np.array(found, np.float64).reshape(-1, 3).T
    weights[vertices.astype(int), groups.astype(int)] = values
    return list(numbers), weights


def _offsets(
    look: Callable, highs: Sequence[bpy.types.Object], found: _Found, keys: Sequence[str]
) -> Task[tuple[dict[str, np.ndarray], list[Sentence]]]:
    """By how much shape keys move the rows (N, 3), in world space, and sentences about those that are left out."""
    seen: dict[str, list[np.ndarray | None]] = {}

    def shown(name: str) -> list[np.ndarray | None]:
        """The rows of each object where this shape key alone has its full value; the first one if it has no such key."""
        if name not in seen:
            with ExitStack() as restore:
                for high in highs:
                    blocks = _blocks(high)
                    if blocks:
                        number = max(0, blocks.find(name))
                        evaluation.set_until(high, "show_only_shape_key", True, restore)
                        evaluation.set_until(high, "active_shape_key_index", number, restore)
                        evaluation.set_until(blocks[number], "mute", False, restore)
                seen[name] = look(partial(_rows, highs, found))
        return seen[name]

    offsets, left_out = {}, []
    for done, name in enumerate(keys):
        yield Progress(f"Reading the shape key {name}", done / len(keys))
        parts = []
        for number, high in enumerate(highs):
            key = next((key for key in _keys(high) if key.name == name), None)
            if key is None:
                parts.append(np.zeros((len(found.rows[number]), 3)))
                continue
            now, before = shown(name)[number], shown(key.relative_key.name)[number]
            if now is None or before is None:
                left_out.append(name)
                break
            parts.append(now - before)
        else:
            offsets[name] = np.concatenate(parts)
    if not left_out:
        return offsets, []
    names = shorten_list(map(repr, left_out))
    text = f"A modifier of {highs[0].name!r} makes another mesh of {names}: the low mesh is without these shape keys."
    return offsets, [Sentence(text, LOOK)]


def _rows(highs: Sequence[bpy.types.Object], found: _Found, depsgraph: bpy.types.Depsgraph) -> list[np.ndarray | None]:
    """Where the rows of each object are, in world space; None for an object that has other vertices now."""
    result = []
    for high, rows, count in zip(highs, found.rows, found.counts, strict=True):
        with mesh_reader.evaluated(high, depsgraph) as data:
            points = mesh_reader.points(data) if count else np.zeros((0, 3), np.float32)
            matrix = mesh_reader.matrix(high.evaluated_get(depsgraph))
            result.append(transformed(points[rows].astype(np.float64), matrix) if len(points) == count else None)
    return result


def _add_keys(low: bpy.types.Object, offsets: dict[str, np.ndarray], highs: Sequence[bpy.types.Object]) -> None:
    """Give a low object shape keys. offsets: by name, (V, 3) in world space."""
    if not offsets:
        return
    own, to_own = mesh_reader.points(low.data), np.linalg.inv(mesh_reader.matrix(low)[:3, :3])
    source = next(high for high in highs if _keys(high))
    low.shape_key_add(name=_blocks(source)[0].name, from_mix=False)
    for name, offset in offsets.items():
        like = next(key for high in highs for key in _keys(high) if key.name == name)
        key = low.shape_key_add(name=name, from_mix=False)
        key.points.foreach_set("co", (own + offset @ to_own.T).astype(np.float32).reshape(-1))
        for each in OF_KEY:
            setattr(key, each, getattr(like, each))
    _move_alike(source.data.shape_keys, low.data.shape_keys)


def _move_alike(source: bpy.types.Key, keys: bpy.types.Key) -> None:
    """Give shape keys the action and the drivers of others of the same names."""
    if source.animation_data is None:
        return
    made = keys.animation_data_create()
    made.action = source.animation_data.action
    if made.action is not None:
        made.action_slot = source.animation_data.action_slot
    for curve in source.animation_data.drivers:
        if any(f'["{bpy.utils.escape_identifier(key.name)}"]' in curve.data_path for key in keys.key_blocks):
            made.drivers.from_existing(src_driver=curve)


def _blocks(obj: bpy.types.Object) -> bpy.types.bpy_prop_collection | tuple[()]:
    keys = getattr(obj.data, "shape_keys", None) if obj.type == "MESH" else None
    return keys.key_blocks if keys is not None and keys.use_relative else ()


def _keys(obj: bpy.types.Object) -> list[bpy.types.ShapeKey]:
    """The shape keys of an object behind the first, which is the mesh itself; none that follow each other in time."""
    return list(_blocks(obj)[1:])


def _layers(obj: bpy.types.Object) -> list[str]:
    """The names of shape keys with a value that move the surface up and down alone: sculptors keep layers of detail so."""
    moving = [key for key in _keys(obj) if key.value and not key.mute]
    if not moving or obj.data.shape_keys.animation_data is not None:
        return []
    up = unit(foreach.vectors(obj.data.vertex_normals).astype(np.float64))
    result = []
    for key in moving:
        ways = foreach.vectors(key.points, "co") - foreach.vectors(key.relative_key.points, "co").astype(np.float64)
        along = ways - up * (ways * up).sum(axis=1, keepdims=True)
        if (along**2).sum() <= ALONG * (ways**2).sum():
            result.append(key.name)
    return result


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


def _mute(ref: ObjectRef, names: Collection[str], value: bool) -> None:
    obj = ref.find()
    for key in _keys(obj) if obj is not None else ():
        if key.name in names:
            key.mute = value
