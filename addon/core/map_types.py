# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps that can be baked, how they share the channels of a packed image, and the states of their texels.

To add a map, add it to OTHERS, with the settings that it alone has: the panel, the command line, job files and names follow.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from .declarations.choices import Axis, IdBy, Pack
from .declarations.kinds import Choice, Item, Option, Setting, Switch

ORIGIN = "imprint_high"
"""A custom property of images of maps: the names of the high objects, one per line."""
MARK = "imprint"
"""A custom property of the nodes and images that Imprint has made: True, or the role of a node that shows a certain map.
Artists may rename nodes; the mark survives renaming, copying and saving, so that a later bake finds the nodes that it may
change."""


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
    PARTS = "the parts of the high objects, by the setting ID By"


class Family(StrEnum):
    """How a map is drawn. Maps of one family come from the same passes."""

    NORMAL = "the normals at the hits"
    POINTS = "the points and labels at the hits, and the points of the low surface"
    OPENNESS = "rays away from the high surface, which others block"
    THICKNESS = "rays into the high surface"
    CURVATURE = "rays to both sides of the high surface"
    MATERIAL = "the materials and attributes of the high meshes"
    SLOPES = "the slopes of the normals, and the roughness of the high meshes' materials"

    @property
    def casts_rays(self) -> bool:
        """Whether the maps cast rays from the hits."""
        return self in (Family.OPENNESS, Family.THICKNESS, Family.CURVATURE)

    @property
    def shows_materials(self) -> bool:
        """Whether the maps change with the materials of the high meshes."""
        return self in (Family.MATERIAL, Family.SLOPES)


@dataclass(frozen=True)
class MapType:
    """One map.

    Attributes:
        name: In settings and job files.
        label, tooltip: In the interface.
        suffix: The ending of the names of its image and files; empty for the map that the settings name.
        short_suffix: The same in names such as T_rock_N, if there is a usual one.
        painter_suffix: The same in names such as rock_normal_base, by which Substance 3D Painter finds mesh maps.
        range: Only for maps of numbers.
        labeled: Only for maps of labels.
        index: In the shader that draws the family.
        is_deep: Whether the map has the depth of the settings, rather than the lowest depth of the format.
        socket: Of the Principled BSDF, for maps of materials.
        is_color: Whether the values are scene-linear colors, which formats without floats store as sRGB.
        is_vector: Whether the channels are the coordinates of points or vectors.
        settings: Those that this map alone has, by their names.
    """

    name: str
    label: str
    tooltip: str
    kind: Kind
    suffix: str
    short_suffix: str = ""
    range: Range = Range.UNIT
    labeled: Labeled | None = None
    family: Family = Family.POINTS
    index: int = -1
    is_deep: bool = True
    socket: str = ""
    is_color: bool = False
    is_vector: bool = False
    painter_suffix: str = ""
    settings: Mapping[str, Setting] = field(default_factory=dict, compare=False)

    @property
    def is_scalar(self) -> bool:
        """Whether all channels have the same value."""
        return self.kind is Kind.VALUE and not self.is_color and not self.is_vector

    @property
    def fills_misses(self) -> bool:
        """Whether texels whose rays miss have the nearest color, with alpha 0, so that filtering mixes no other into it.

        Not maps that say what is there, as heights and opacity: a filled hole would be wrong.
        """
        return self.kind is Kind.VALUE and self.family is not Family.POINTS and self.socket != "Alpha"

    @property
    def is_signed(self) -> bool:
        """Whether its numbers can be below 0."""
        return self.range in (Range.SIGNED, Range.BOX)

    @property
    def is_gray(self) -> bool:
        """Whether the red, green and blue of its texels are the same."""
        return self.is_scalar or self.kind is Kind.STATE

    @property
    def is_unbounded(self) -> bool:
        """Whether the numbers can be of any size: lengths in scene units, and attributes. 16-bit floats may not hold them."""
        return self.kind is Kind.VALUE and not self.socket and (self.range is not Range.UNIT or self.is_color)

    @property
    def title(self) -> str:
        """The name of the map in a sentence."""
        return self.label.lower() if self.kind is Kind.STATE else f"{self.label.lower()} map"


NORMAL = MapType("NORMAL", "Normal", "The normals of the high surface", Kind.NORMAL, "", family=Family.NORMAL)
MASK = MapType("MASK", "Miss Mask", "White where rays hit nothing", Kind.STATE, "missed", is_deep=False)


def _of_socket(
    name: str, label: str, socket: str, short: str = "", *, is_color: bool = False, value_range: Range = Range.UNIT
) -> MapType:
    """The map of a socket of the high materials' Principled BSDF."""
    return MapType(
        name,
        label,
        f"{label} of the high meshes' materials",
        Kind.VALUE,
        name.lower(),
        short,
        range=value_range,
        family=Family.MATERIAL,
        socket=socket,
        is_color=is_color,
    )


HEIGHT = MapType(
    "HEIGHT",
    "Height",
    "Distance from the low surface to the high one along the low surface's normal",
    Kind.VALUE,
    "height",
    "H",
    range=Range.SIGNED,
    index=1,
    painter_suffix="height_base",
)
VECTOR_DISPLACEMENT = MapType(
    "DISPLACEMENT",
    "Vector Displacement",
    "Vector from the low surface to the high one",
    Kind.VALUE,
    "displacement",
    range=Range.SIGNED,
    index=2,
    is_vector=True,
    settings={
        "tangent_displacement": Switch(
            label="Tangent Displacement",
            tooltip="Store vector displacement along tangent, normal and bitangent, as Blender's Vector Displacement node "
            "reads it in tangent space. For normal maps in tangent space",
        ),
    },
)
PART_ID = MapType(
    "PART_ID",
    "Part ID",
    "A color for each part of the high objects: loose parts, or what ID By names",
    Kind.LABEL,
    "part_id",
    labeled=Labeled.PARTS,
    index=7,
    is_deep=False,
    settings={
        "id_by": Choice(
            label="ID By",
            tooltip="What has a color of its own in the part ID map",
            default=IdBy.LOOSE_PART,
            items=(
                Item(IdBy.LOOSE_PART, "Loose Parts", "Faces that are connected"),
                Item(IdBy.UV_ISLAND, "UV Islands", "Faces that are connected in the UV map"),
                Item(IdBy.FACE_SET, "Face Sets", "Those of Sculpt Mode"),
                Item(IdBy.COLOR, "Vertex Colors", "Faces of one color, by the active color attribute"),
                Item(IdBy.COLLECTION, "Collections", "The first collection of each object"),
            ),
        ),
    },
)
GRADIENT = MapType(
    "GRADIENT",
    "Gradient",
    "Position along the Gradient Axis, 0 to 1 from end to end of the low mesh, in the position map's space",
    Kind.VALUE,
    "gradient",
    index=8,
    settings={
        "gradient_axis": Choice(
            label="Gradient Axis",
            tooltip="Axis along which the gradient map rises",
            default=Axis.Z,
            items=tuple(Item(axis, str(axis), f"From the lowest {axis.lower()} to the highest") for axis in Axis),
            option=Option(explains=False),
        ),
    },
)
AO = MapType(
    "AO",
    "Ambient Occlusion",
    "The share of the sky that each point of the high surface sees: 1 sees all of it",
    Kind.VALUE,
    "ao",
    "AO",
    family=Family.OPENNESS,
    painter_suffix="ambient_occlusion",
)
BASE_COLOR = _of_socket("BASE_COLOR", "Base Color", "Base Color", "BC", is_color=True)
ROUGHNESS = _of_socket("ROUGHNESS", "Roughness", "Roughness", "R")
WIDENED_ROUGHNESS = MapType(
    "WIDENED_ROUGHNESS",
    "Widened Roughness",
    "Roughness of the high meshes' materials, widened by the detail that is finer than a texel",
    Kind.VALUE,
    "widened_roughness",
    family=Family.SLOPES,
    socket="Roughness",
)
METALLIC = _of_socket("METALLIC", "Metallic", "Metallic", "M")
EMISSION = _of_socket("EMISSION", "Emission", "Emission Color", "E", is_color=True, value_range=Range.POSITIVE)
ATTRIBUTE = MapType(
    "ATTRIBUTE",
    "Attribute",
    "An attribute of the high meshes, such as vertex colors",
    Kind.VALUE,
    "attribute",
    family=Family.MATERIAL,
    is_color=True,
)
OTHERS = (
    MapType(
        "POSITION",
        "Position",
        "Position of the high surface, in the low object's space or, for world space, in the world's",
        Kind.VALUE,
        "position",
        range=Range.BOX,
        index=0,
        is_vector=True,
    ),
    HEIGHT,
    VECTOR_DISPLACEMENT,
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
        painter_suffix="id",
    ),
    AO,
    MapType(
        "BENT_NORMAL",
        "Bent Normal",
        "The mean direction from which each point of the high surface sees the sky, in the space and the channels of the "
        "normal map",
        Kind.NORMAL,
        "bent_normal",
        family=Family.OPENNESS,
        painter_suffix="bent_normals_base",
    ),
    MapType(
        "THICKNESS",
        "Thickness",
        "The mean length of rays into the high surface, up to the thickness distance: black is thin, white is thick",
        Kind.VALUE,
        "thickness",
        family=Family.THICKNESS,
        index=0,
    ),
    MapType(
        "CURVATURE",
        "Curvature",
        "The share of a ball around each point that is outside the high surface: gray is flat, white an edge of 90 degrees, "
        "black a groove of 90 degrees",
        Kind.VALUE,
        "curvature",
        family=Family.CURVATURE,
        index=0,
    ),
    MapType(
        "CONVEXITY",
        "Convexity",
        "The edges of the curvature map: black is flat, white an edge of 90 degrees",
        Kind.VALUE,
        "convexity",
        family=Family.CURVATURE,
        index=1,
    ),
    MapType(
        "CAVITY",
        "Cavity",
        "The grooves of the curvature map: black is flat, white a groove of 90 degrees",
        Kind.VALUE,
        "cavity",
        family=Family.CURVATURE,
        index=2,
    ),
    BASE_COLOR,
    ROUGHNESS,
    WIDENED_ROUGHNESS,
    METALLIC,
    EMISSION,
    replace(_of_socket("ALPHA", "Alpha", "Alpha"), painter_suffix="opacity_base"),
    _of_socket("SPECULAR", "Specular", "Specular IOR Level"),
    _of_socket("TRANSMISSION", "Transmission", "Transmission Weight"),
    _of_socket("COAT", "Coat", "Coat Weight"),
    _of_socket("SHEEN", "Sheen", "Sheen Weight"),
    _of_socket("SUBSURFACE", "Subsurface", "Subsurface Weight"),
    ATTRIBUTE,
    PART_ID,
    GRADIENT,
)
"""The maps that can be baked beside the normal map, in the order of baking. Files of Blender hold the places of the chosen
ones: a new one goes to the end."""
SETTINGS: Mapping[str, Setting] = MappingProxyType(
    {name: setting for map_type in OTHERS for name, setting in map_type.settings.items()}
)
"""Those that single maps have."""
NAMES = tuple(map_type.name for map_type in OTHERS)
BY_NAME = MappingProxyType({map_type.name: map_type for map_type in (NORMAL, MASK, *OTHERS)})


MARGIN, WRITTEN, MISSED, DEFERRED, FILLED = 1, 2, 3, 4, 5
"""States of a texel, as in shaders/lib/state_lib.glsl; 0 is background. The margin fills deferred texels later.
Filled ones are missed, and have the color of the nearest."""

Map = tuple[np.ndarray, np.ndarray]
"""Texels (height, width, 4) float32 as they are stored, and their state (height, width) uint8."""


def states_of_raw(alpha: np.ndarray) -> np.ndarray:
    """The states, uint8, of texels without a margin, from the alpha of their normals."""
    return np.where(alpha > 0.0, WRITTEN, np.where(alpha < 0.0, MISSED, 0)).astype(np.uint8)


ZERO, ONE, SMOOTHNESS = "ZERO", "ONE", "SMOOTHNESS"
"""What a channel of a packed image can store beside a map. SMOOTHNESS is 1 - roughness."""
RGBA = ("red", "green", "blue", "alpha")
"""The channels by name, in their order."""


@dataclass(frozen=True)
class Channel:
    """The content of a channel: a map, or the number `constant` where `map` is empty.

    Attributes:
        is_inverted: 1 - value.
    """

    map: str = ""
    is_inverted: bool = False
    constant: float = 0.0

    @classmethod
    def of(cls, value: str) -> "Channel":
        """The channel that the value of a setting such as pack_red describes."""
        if value in (ZERO, ONE):
            return cls(constant=float(value == ONE))
        return cls(ROUGHNESS.name, is_inverted=True) if value == SMOOTHNESS else cls(value)


WHITE = Channel(constant=1.0)
"""The content of an alpha that files need not store."""


@dataclass(frozen=True)
class Packing:
    """A layout.

    Attributes:
        suffix, short_suffix: The endings of the names of its image and files, as those of a MapType.
        channels: Red, green, blue and alpha.
    """

    suffix: str
    channels: tuple[Channel, Channel, Channel, Channel]
    short_suffix: str = ""

    @classmethod
    def of(cls, suffix: str, *values: str, short_suffix: str = "") -> "Packing":
        """The layout of the four values of settings such as pack_red."""
        red, green, blue, alpha = map(Channel.of, values)
        return cls(suffix, (red, green, blue, alpha), short_suffix)

    @property
    def maps(self) -> tuple[str, ...]:
        """The maps in it, by name."""
        return tuple(dict.fromkeys(channel.map for channel in self.channels if channel.map))

    @property
    def map_type(self) -> MapType:
        """A map type for the names and the depth of the image."""
        is_unbounded = any(BY_NAME[name].is_unbounded for name in self.maps)
        bounds = Range.SIGNED if is_unbounded else Range.UNIT
        return MapType("PACKED", "Packed", "", Kind.VALUE, self.suffix, self.short_suffix, range=bounds)

    def of_widened_roughness(self) -> "Packing":
        """The same layout with the widened roughness in place of the material's."""
        return replace(
            self,
            channels=tuple(
                replace(channel, map=WIDENED_ROUGHNESS.name) if channel.map == ROUGHNESS.name else channel
                for channel in self.channels
            ),
        )

    def by_name(self) -> dict[str, Channel]:
        """The channels by their names."""
        return dict(zip(RGBA, self.channels, strict=True))


_ORM = Packing.of("orm", AO.name, ROUGHNESS.name, METALLIC.name, ONE, short_suffix="ORM")

PACKINGS: Mapping[str, Packing] = MappingProxyType(
    {
        # glTF 2.0 lets occlusion (red) share the image of roughness (green) and metallic (blue). Unreal's usual masks and
        # Godot's ORMMaterial3D have the same order.
        Pack.GLTF: _ORM,
        Pack.UNREAL: _ORM,
        Pack.GODOT: _ORM,
        Pack.URP: Packing.of("metallic_smoothness", METALLIC.name, ZERO, ZERO, SMOOTHNESS),
        # The detail mask in blue is 1 where a detail map shows. Without a mask it shows everywhere.
        Pack.HDRP: Packing.of("mask", METALLIC.name, AO.name, ONE, SMOOTHNESS),
    }
)
CUSTOM_SUFFIX = "packed"
"""The suffix of a layout of one's own."""
