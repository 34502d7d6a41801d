# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the panels Imprint, Pairs by Name and Levels of Detail: which objects to bake."""

from .. import levels
from ..naming import Suffixes
from .kinds import ObjectSlot, ObjectSlots, Option, Setting, Switch, Text

_USUAL = Suffixes()

BAKE: dict[str, Setting] = {
    "highs": ObjectSlots(
        label="High",
        tooltip="High-poly objects, which have the detail: meshes, curves, text, or objects that show instances",
        empty="the selected objects",
        option=Option(word="high", default="the low object with its modifiers", note="The option may be repeated"),
    ),
    "low": ObjectSlot(
        label="Low", tooltip="Low-poly mesh, which gets the map", empty="the active object", option=Option(default="")
    ),
    "live_every_time": Switch(
        label="Write Every Map",
        tooltip="While Live is on, write each map to the image at once, and not only when editing pauses",
        option=None,
    ),
}
PAIRS: dict[str, Setting] = {
    "low_suffix": Text(
        label="Low", tooltip="Ending of the names of low objects, in any case", default=_USUAL.low, option=None
    ),
    "high_suffix": Text(
        label="High",
        tooltip="Ending of the names of high objects, in any case. An underscore and more may follow it",
        default=_USUAL.high,
        option=None,
    ),
    "cage_suffix": Text(
        label="Cage", tooltip="Ending of the names of cages, in any case", default=_USUAL.cage, option=None
    ),
    "share_image": Switch(label="One Image", tooltip="Bake all pairs into one image, an atlas", option=None),
}
LEVELS: dict[str, Setting] = {
    "level_degrees": Text(
        label="Degrees",
        tooltip="For each level, the largest angle between the normals that it shows with its map and those of "
        "the mesh, on 99 % of the texels",
        default=levels.DEGREES,
        option=None,
    ),
    "level_distance": Text(
        label="Distance (%)",
        tooltip="The largest distance of the levels from the mesh, in percent of the longest side of its box: "
        "one number for all levels, or one for each",
        default=levels.PERCENT,
        option=None,
    ),
}
