# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the selected objects are baked each for itself, and not as the high objects of the active one.

Each gets what it would get if it were selected alone: its own materials and shape, or the detail of its pair. That is so if
nothing says that one of them is high: neither a slot, a name, a pair, a cage nor Flatten, and if no two of them lie over one
another. Where only the last two are not so, the panel has a button for it. What a name or a pair calls low is not baked as a
high object onto another low one: the panel leaves it out, with its high objects, and has a button that makes a set of all.
"""

from collections.abc import Sequence
from itertools import compress
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..core import naming
from ..core.declarations.choices import Method
from ..scene import object_checks
from . import object_pairs
from .callbacks import until_change

if TYPE_CHECKING:
    from .properties import ImprintSettings

REACH = 0.12
"""How near two objects may be a pair, as a share of the diagonal of the smaller one's box: as far as Own Hit reaches."""
SHARE = 0.5
"""The share of a box within the enlarged box of another from which these lie over one another. Of cubes side by side it is
0.21, of one that stands on a ground 0.3, of a sculpt and its low mesh about 1."""
FLAT = 0.01
"""The least thickness of a box, as a share of its diagonal."""


def lows(context: bpy.types.Context, panel: "ImprintSettings") -> list[bpy.types.Object]:
    """The low objects of a bake of several at once; empty if the panel bakes one."""
    objects = candidates(context, panel) if panel.cage is None else []
    if len(objects) > 1 and all(naming.role(obj.name, panel.suffixes()) == "low" for obj in objects):
        return objects  # wherever they lie
    if len(objects) < 2 or panel.method == Method.FLATTEN:
        return []
    key = tuple(obj.session_uid for obj in objects)
    return [] if until_change.get("lie over", key, lambda: lie_over(objects)) else objects


def candidates(context: bpy.types.Context, panel: "ImprintSettings") -> list[bpy.types.Object]:
    """The selected objects, the active one first, if there are several and none is high by a name or a pair; else empty."""
    active = context.active_object
    if panel.low is not None or any(slot.title for slot in panel.highs) or active is None or not active.select_get():
        return []
    selected = [active, *(obj for obj in context.view_layer.objects.selected if obj != active)]
    # The places of those that are baked, since objects that are kept may be deleted.
    key = (panel.suffixes(), *((obj.session_uid, obj.name) for obj in selected))
    return [selected[place] for place in until_change.get("candidates", key, lambda: _places(panel, selected))]


def _places(panel: "ImprintSettings", selected: Sequence[bpy.types.Object]) -> list[int]:
    """The places of `candidates` in the selection, which begins with the active object."""
    pairs = list(filter(None, map(object_pairs.of, selected)))
    cages = {pair.cage for pair in pairs}
    may_be = [not place or (obj not in cages and object_checks.may_show(obj)) for place, obj in enumerate(selected)]
    objects = list(compress(selected, may_be))
    highs = {high for pair in pairs if not pair.is_own for high in pair.found()}
    is_high = any(obj.type != "MESH" or obj in highs or _is_called_high(obj, panel) for obj in objects)
    return [] if is_high or len(objects) < 2 else list(compress(range(len(selected)), may_be))


def others(
    context: bpy.types.Context, panel: "ImprintSettings", low: bpy.types.Object | None
) -> list[bpy.types.Object]:
    """The selected objects that a name or a pair calls low, beside `low`, which is one of these, too; else empty."""
    if low is None or not is_low(low, panel):
        return []
    selected = context.view_layer.objects.selected
    key = (low.session_uid, panel.suffixes(), *((obj.session_uid, obj.name) for obj in selected))
    uids = until_change.get("other lows", key, lambda: _others(panel, low, selected))
    return [obj for obj in selected if obj.session_uid in uids] if uids else []


def _others(panel: "ImprintSettings", low: bpy.types.Object, selected: Sequence[bpy.types.Object]) -> set[int]:
    pair = object_pairs.of(low)
    own = {low, *pair.found(), pair.cage} if pair is not None else {low}
    return {obj.session_uid for obj in selected if obj not in own and is_low(obj, panel)}


def is_low(obj: bpy.types.Object, panel: "ImprintSettings") -> bool:
    """Whether a name or a pair calls an object low. One that was baked onto itself may be a high object, too."""
    if obj.type != "MESH" or _is_called_high(obj, panel):
        return False
    pair = object_pairs.of(obj)
    is_paired = pair is not None and pair.is_kept and not pair.is_own
    return is_paired or naming.role(obj.name, panel.suffixes()) == "low"


def _is_called_high(obj: bpy.types.Object, panel: "ImprintSettings") -> bool:
    return naming.role(obj.name, panel.suffixes()) in {"high", "cage"}


def lie_over(objects: Sequence[bpy.types.Object]) -> bool:
    """Whether two of them lie over one another, so that one may be high."""
    if len(objects) < 2:
        return False
    least, most = boxes(objects)
    diagonal = np.linalg.norm(most - least, axis=1, keepdims=True)
    thin = np.maximum(0.0, FLAT * diagonal - (most - least)) / 2.0
    least, most = least - thin, most + thin
    volumes = np.maximum(_volumes(most - least), 1e-300)
    for number in range(len(objects)):  # by rows: a square of hundreds of objects is large
        reach = REACH * np.minimum(diagonal, diagonal[number])
        shared = np.minimum(most[number] + reach, most) - np.maximum(least[number] - reach, least)
        shares = _volumes(np.maximum(shared, 0.0)) / volumes
        shares[number] = 0.0
        if shares.max() > SHARE:
            return True
    return False


def _volumes(sides: np.ndarray) -> np.ndarray:
    return sides[:, 0] * sides[:, 1] * sides[:, 2]


def boxes(objects: Sequence[bpy.types.Object]) -> tuple[np.ndarray, np.ndarray]:
    """The least and the most coordinates (N, 3) of the boxes of objects, in world space."""
    ends = np.array([[(*box[0],), (*box[6],)] for box in (obj.bound_box for obj in objects)])
    matrices = np.array([[(*row,) for row in obj.matrix_world] for obj in objects])
    center, half = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2.0
    center = np.einsum("nij,nj->ni", matrices[:, :3, :3], center) + matrices[:, :3, 3]
    half = np.einsum("nij,nj->ni", np.abs(matrices[:, :3, :3]), half)
    return center - half, center + half
