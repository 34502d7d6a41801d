# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs the UV islands of several objects into one map, or one for each material, at one texel density, and later those of more
objects beside them.

Each object gets a UV map of its own for it, and keeps its other ones. Islands of an object that lie on each other stay so, if
they have the same material.
"""

from collections.abc import Collection, Sequence
from typing import Any

import bpy
import numpy as np

from ..audit import mip_gaps
from ..core.errors import BakeError, shorten_list
from ..core.progress import Progress, Task, finish, part
from ..core.settings import Settings
from ..mesh import uv_packing
from ..mesh.uv_packing import PackOptions
from ..mesh.uv_stacks import Stacks
from ..scene import mesh_reader
from ..scene.high_materials import sets_of
from .unwrapping import MOST

LAYER = "Atlas"
"""The UV map of each object."""
INSIDE = 1e-5
"""By how much packed UVs may be outside of the map."""
SAME_DENSITY = 1.02
"""The quotient of the largest and the smallest factor to one texel density that counts as one."""
Textures = dict[str, dict[bpy.types.Object, Stacks]]
"""The islands of objects that are in a texture, by the name of its material; empty for one texture of all."""


def pack(lows: Sequence[bpy.types.Object], settings: Settings, **how: Any) -> str:
    """`work`, done at once."""
    return finish(work(lows, settings, **how))


def work(
    lows: Sequence[bpy.types.Object],
    settings: Settings,
    *,
    only: Collection[bpy.types.Object] | None = None,
    is_done_once: bool = False,
    is_anew: bool = False,
) -> Task[str]:
    """Give objects a UV map in which their islands, as their active UV maps have them, lie side by side; with texture sets,
    those of each material by themselves.

    Objects that have it already keep their places, and where all have it and are packed, nothing changes. Returns a sentence.
    Raises BakeError; then, and if it is closed before its end, nothing has changed.

    Args:
        only: those that are packed, anew or for the first time; all others keep their places.
        is_done_once: whether objects keep their places even if they lie on each other.
        is_anew: whether all are packed anew.
    """
    yield Progress("Reading UV maps", 0.0)
    _check(lows)
    margin = mip_gaps.needed(settings.sampling) / 2.0 / min(settings.sampling.size)
    by_material = settings.map.texture_sets
    staying = [low for low in lows if (LAYER in low.data.uv_layers if only is None else low not in only)]
    if only is None and len(staying) == len(lows) and not is_done_once:
        is_anew = is_anew or not _are_packed(_textures(lows, by_material=by_material), margin)
    coming = [low for low in lows if is_anew or low not in staying]
    staying = [low for low in lows if low not in coming]
    here, there = _textures(coming, by_material=by_material), _textures(staying, by_material=by_material)
    packed = yield from part(_packed(here, there, margin), 0.1, 1.0)
    for low, coordinates in packed.items():
        layers = low.data.uv_layers
        layer = layers[LAYER] if LAYER in layers else layers.new(name=LAYER, do_init=False)
        layer.uv.foreach_set("vector", np.ascontiguousarray(coordinates, np.float32).reshape(-1))
    for low in (low for low in lows if LAYER in low.data.uv_layers):
        low.data.uv_layers.active = low.data.uv_layers[LAYER]
        low.data.update()
    textures = _textures(lows, by_material=by_material).values()
    used = np.mean([sum(each.used for each in of_texture.values()) for of_texture in textures])
    share = f"{used:.0%} of the map used" if len(textures) == 1 else f"{used:.0%} of {len(textures)} maps used"
    if not coming:
        return f"{shorten_list(repr(low.name) for low in lows)} have the UV map {LAYER!r} already: {share}"
    kept = f", beside {len(staying):,} that kept their places" if staying else ""
    return f"{shorten_list(repr(low.name) for low in coming)} have the UV map {LAYER!r}{kept}: {share}"


def _check(lows: Sequence[bpy.types.Object]) -> None:
    for low in lows:
        if low.mode != "OBJECT":
            raise BakeError(f"{low.name!r} is not in Object Mode: go there first.")
        if low.type != "MESH" or not low.data.polygons:
            raise BakeError(f"{low.name!r} has no faces: leave it out.")
        if not low.data.uv_layers:
            raise BakeError(f"{low.name!r} has no UV map: unwrap it first.")
        if low.data.library is not None:
            raise BakeError(f"{low.name!r} is linked from another file: pack it there, or make it local.")
        if low.data.users > 1:
            raise BakeError(f"{low.name!r} shares its mesh with other objects: make it a single user.")
        if LAYER not in low.data.uv_layers and len(low.data.uv_layers) == MOST:
            raise BakeError(f"{low.name!r} has as many UV maps as a mesh can have: remove one.")
        if not sum(each[low].drawn for each in _textures([low]).values()):
            raise BakeError(f"The UV map {_layer(low)!r} of {low.name!r} has no area: unwrap it anew.")


def _textures(lows: Sequence[bpy.types.Object], *, by_material: bool = False) -> Textures:
    """The islands of objects by texture: of all, or of each material."""
    found: Textures = {}
    for low in lows:
        mesh = mesh_reader.surface(
            low.data, _layer(low), low.name, np.array(low.matrix_world, np.float64), with_faces=True
        )
        slots = mesh_reader.material_slots(low.data, mesh, max(1, len(low.material_slots)))
        kinds = _kinds(low)[slots]
        for one in sets_of(low, is_own_base=True) if by_material else [None]:
            chosen = slice(None) if one is None else np.isin(slots, one.slots)
            part = mesh.with_triangles(chosen)
            if len(part.triangles):
                found.setdefault("" if one is None else one.name, {})[low] = Stacks(part, kinds[chosen])
    return found


def _kinds(low: bpy.types.Object) -> np.ndarray:
    """A number from 0 for each material slot, equal for those with the same material."""
    materials = [slot.material for slot in low.material_slots] or [None]
    return np.array([materials.index(material) for material in materials])


def _are_packed(textures: Textures, margin: float) -> bool:
    """Whether islands lie side by side in the map, at one texel density."""
    for of_texture in map(list, map(dict.values, textures.values())):
        factors = np.concatenate([each.factors[each.factors > 0.0] for each in of_texture])
        points, triangles, _ = _joined([(each.points, each) for each in of_texture])
        corners = points[triangles]
        is_in = corners.min() >= -INSIDE and corners.max() <= 1.0 + INSIDE
        if not is_in or factors.max() > factors.min() * SAME_DENSITY:
            return False
        if not uv_packing.are_apart(corners, _islands(of_texture, triangles), margin):
            return False
    return True


def _packed(textures: Textures, staying: Textures, margin: float) -> Task[dict[bpy.types.Object, np.ndarray]]:
    """The UVs of those that come: packed anew as large as they fit, or as large as those that stay, between their islands."""
    result: dict[bpy.types.Object, np.ndarray] = {}
    for done, (name, here) in enumerate(textures.items()):
        yield Progress(f"Packing the UV islands of {name}" if name else "Packing UV islands", done / len(textures))
        there = [*staying.get(name, {}).values()]
        start, stop = (step / len(textures) for step in (done, done + 1))
        placed = yield from part(_placed([*here.values()], there, margin), start, stop)
        if placed is None:
            names = shorten_list(repr(low.name) for low in here)
            raise BakeError(
                f"{names} do not fit between the islands of the UV map {LAYER!r}: remove it from all of them, and pack them "
                "together."
                if there
                else f"The UV islands of {names} do not fit into a map with their margins: take a larger one."
            )
        for (low, each), uv in zip(here.items(), placed, strict=True):
            if low not in result:
                result[low] = mesh_reader.uvs(low.data, _layer(low)).astype(np.float64)
            result[low][each.corners] = uv
    return result


def _placed(here: Sequence[Stacks], there: Sequence[Stacks], margin: float) -> Task[list[np.ndarray] | None]:
    """The new UVs of the corners of each of `here`, beside those of `there`; None if they do not fit."""
    size = np.sqrt(sum(each.drawn for each in there) / sum(each.surface for each in there)) if there else 1.0
    points, triangles, starts = _joined([(each.scaled(size), each) for each in here])
    staying = np.concatenate([each.points[each.triangles] for each in there]) if there else None
    packed = yield from uv_packing.work(
        points, triangles, PackOptions(margin, _islands(here, triangles), staying=staying)
    )
    if packed is None:
        return None
    return [each.placed(part) for each, part in zip(here, np.split(packed, starts[1:-1]), strict=True)]


def _islands(parts: Sequence[Stacks], triangles: np.ndarray) -> np.ndarray:
    """The island (T,) int of each triangle of `_joined`."""
    first = np.cumsum([0, *(len(each.factors) for each in parts)])
    islands = [each.of[each.places] + start for each, start in zip(parts, first[:-1], strict=True)]
    return np.concatenate(islands)[triangles[:, 0]]


def _joined(parts: Sequence[tuple[np.ndarray, Stacks]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The UVs (P, 2) of all places, the triangles (T, 3) of all, and where the places of each begin, with their number at the
    end. parts: these UVs of each."""
    starts = np.cumsum([0, *(len(uv) for uv, _ in parts)])
    triangles = [each.triangles + start for (_, each), start in zip(parts, starts[:-1], strict=True)]
    return np.concatenate([uv for uv, _ in parts]), np.concatenate(triangles), starts


def _layer(low: bpy.types.Object) -> str:
    """The UV map whose islands are packed."""
    return LAYER if LAYER in low.data.uv_layers else mesh_reader.active_uv_layer(low.data)
