# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps that a bake makes. To add one, add it to OTHERS: nothing else names a map."""

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType


class Kind(StrEnum):
    """What a texel holds, which decides how samples and margins are made."""

    NORMAL = "a unit normal"
    VALUE = "numbers that have a mean"
    LABEL = "the number of an object or a material, which has no mean"
    STATE = "white where rays hit nothing"


class Range(StrEnum):
    """How values become channels from 0 to 1 in formats that cannot store them as they are, and what undoes it."""

    UNIT = "value = stored"
    POSITIVE = "value = stored * scale"
    SIGNED = "value = (stored - 0.5) * scale"
    BOX = "value = stored * scale + offset"


class Labeled(StrEnum):
    """What the numbers of a label map stand for."""

    OBJECTS = "the high objects"
    MATERIALS = "the materials of the high objects"


@dataclass(frozen=True)
class MapType:
    """One map.

    name: in settings and job files. label, tooltip: in the interface. suffix: what the names of its image and files end in;
    empty for the map that the settings name. range: for numbers. labeled: for labels. index: in shaders/bake/
    surface_values_frag.glsl, for maps that it draws. is_deep: whether it is stored in the depth of the settings, rather than in
    the lowest that the format has.
    """

    name: str
    label: str
    tooltip: str
    kind: Kind
    suffix: str
    range: Range = Range.UNIT
    labeled: Labeled | None = None
    index: int = -1
    is_deep: bool = True

    @property
    def title(self) -> str:
        """What it is called in a sentence."""
        return self.label.lower() if self.kind is Kind.STATE else f"{self.label.lower()} map"


NORMAL = MapType("NORMAL", "Normal", "The normals of the high surface", Kind.NORMAL, "")
MASK = MapType("MASK", "Miss Mask", "White where rays hit nothing", Kind.STATE, "missed", is_deep=False)
OTHERS = (
    MapType(
        "POSITION",
        "Position",
        "Position of the high surface, in the low object's space or, for world space, in the world's",
        Kind.VALUE,
        "position",
        range=Range.BOX,
        index=0,
    ),
    MapType(
        "HEIGHT",
        "Height",
        "Distance from the low surface to the high one along the low surface's normal",
        Kind.VALUE,
        "height",
        range=Range.SIGNED,
        index=1,
    ),
    MapType(
        "DISPLACEMENT",
        "Vector Displacement",
        "Vector from the low surface to the high one",
        Kind.VALUE,
        "displacement",
        range=Range.SIGNED,
        index=2,
    ),
    MapType(
        "DISTANCE",
        "Distance",
        "Distance from the low surface to the high one in any direction",
        Kind.VALUE,
        "distance",
        range=Range.POSITIVE,
        index=3,
    ),
    MapType(
        "COVERAGE",
        "Coverage",
        "White where a high object covers the texel",
        Kind.VALUE,
        "coverage",
        index=4,
        is_deep=False,
    ),
    MapType(
        "OBJECT_ID",
        "Object ID",
        "A color for each high object",
        Kind.LABEL,
        "object_id",
        labeled=Labeled.OBJECTS,
        index=5,
        is_deep=False,
    ),
    MapType(
        "MATERIAL_ID",
        "Material ID",
        "A color for each material of the high objects",
        Kind.LABEL,
        "material_id",
        labeled=Labeled.MATERIALS,
        index=6,
        is_deep=False,
    ),
)
"""The maps that can be baked beside the normal map, in the order in which they are made."""
NAMES = tuple(one.name for one in OTHERS)
BY_NAME = MappingProxyType({one.name: one for one in (NORMAL, MASK, *OTHERS)})
