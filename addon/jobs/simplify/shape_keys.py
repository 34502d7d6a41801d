# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads by how much shape keys move a surface, and gives low objects the same ones."""

from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from functools import partial

import bpy
import numpy as np

from ...core import foreach
from ...core.errors import shorten_list
from ...core.progress import Progress, Task
from ...core.sentences import LOOK, Sentence
from ...mesh.triangles import transformed, unit
from ...scene import evaluation, mesh_reader
from ...scene.object_checks import ObjectRef
from .skin_weights import Found

ALONG = 0.1
"""The share of a shape key's squared movement that may lie along the surface if it is a layer of detail."""
OF_KEY = "slider_min", "slider_max", "value", "interpolation"
"""Those of a shape key."""


def keys_of(obj: bpy.types.Object) -> list[bpy.types.ShapeKey]:
    """The shape keys of an object behind the first, which is the mesh itself; none that follow each other in time."""
    return list(_blocks(obj)[1:])


def layers(obj: bpy.types.Object) -> list[str]:
    """The names of shape keys with a value that move the surface up and down alone: sculptors keep layers of detail so."""
    moving = [key for key in keys_of(obj) if key.value and not key.mute]
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


def mute(ref: ObjectRef, names: Collection[str], value: bool) -> None:
    """Mute or unmute the shape keys of these names, if the object is still there."""
    obj = ref.find()
    for key in keys_of(obj) if obj is not None else ():
        if key.name in names:
            key.mute = value


def offsets_of(
    look: Callable, highs: Sequence[bpy.types.Object], found: Found, names: Sequence[str]
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
    for done, name in enumerate(names):
        yield Progress(f"Reading the shape key {name}", done / len(names))
        parts = []
        for number, high in enumerate(highs):
            key = next((key for key in keys_of(high) if key.name == name), None)
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
    listed = shorten_list(map(repr, left_out))
    text = f"A modifier of {highs[0].name!r} makes another mesh of {listed}: the low mesh is without these shape keys."
    return offsets, [Sentence(text, LOOK)]


def add(low: bpy.types.Object, offsets: dict[str, np.ndarray], highs: Sequence[bpy.types.Object]) -> None:
    """Give a low object shape keys. offsets: by name, (V, 3) in world space."""
    if not offsets:
        return
    own, to_own = mesh_reader.points(low.data), np.linalg.inv(mesh_reader.matrix(low)[:3, :3])
    source = next(high for high in highs if keys_of(high))
    low.shape_key_add(name=_blocks(source)[0].name, from_mix=False)
    for name, offset in offsets.items():
        like = next(key for high in highs for key in keys_of(high) if key.name == name)
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


def _rows(highs: Sequence[bpy.types.Object], found: Found, depsgraph: bpy.types.Depsgraph) -> list[np.ndarray | None]:
    """Where the rows of each object are, in world space; None for an object that has other vertices now."""
    result = []
    for high, rows, count in zip(highs, found.rows, found.counts, strict=True):
        with mesh_reader.evaluated(high, depsgraph) as data:
            points = mesh_reader.points(data) if count else np.zeros((0, 3), np.float32)
            matrix = mesh_reader.matrix(high.evaluated_get(depsgraph))
            result.append(transformed(points[rows].astype(np.float64), matrix) if len(points) == count else None)
    return result


def _blocks(obj: bpy.types.Object) -> bpy.types.bpy_prop_collection | tuple[()]:
    keys = getattr(obj.data, "shape_keys", None) if obj.type == "MESH" else None
    return keys.key_blocks if keys is not None and keys.use_relative else ()
