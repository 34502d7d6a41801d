# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps that can be baked. To add one, add it to OTHERS: no other module names a map."""

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType


class Kind(StrEnum):
    """The kind of values in a map. Sampling and margins depend on it."""

    NORMAL = "a unit normal"
    VALUE = "numbers that have a mean"
    LABEL = "the number of an object or a material, which has no mean"
    STATE = "white where rays hit nothing"


class Range(StrEnum):
    """How formats without floats store values as channels from 0 to 1. Each formula decodes them."""

    UNIT = "value = stored"
    POSITIVE = "value = stored * scale"
    SIGNED = "value = (stored - 0.5) * scale"
    BOX = "value = stored * scale + offset"


class Labeled(StrEnum):
    """The things that a label map numbers."""

    OBJECTS = "the high objects"
    MATERIALS = "the materials of the high objects"


@dataclass(frozen=True)
class MapType:
    """One map.

    name: in settings and job files. label, tooltip: in the interface. suffix: the ending of the names of its image and files;
    empty for the map that the settings name. range: only for maps of numbers. labeled: only for maps of labels. index: in
    shaders/bake/height_position_ids_frag.glsl, for maps that this shader draws. is_deep: whether the map has the depth of the
    settings, rather than the lowest depth of the format.
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
        """The name of the map in a sentence."""
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
"""The maps that can be baked beside the normal map, in the order of baking."""
NAMES = tuple(map_type.name for map_type in OTHERS)
BY_NAME = MappingProxyType({map_type.name: map_type for map_type in (NORMAL, MASK, *OTHERS)})
