# SPDX-License-Identifier: GPL-3.0-or-later
"""The values of settings that code compares. They are strings as well, so that reports and presets contain plain words."""

from enum import StrEnum


class Method(StrEnum):
    """How the detail of the high mesh gets into the map."""

    AUTO = "AUTO"
    FLATTEN = "FLATTEN"
    CAST = "CAST"


class Space(StrEnum):
    """The space of the normals."""

    TANGENT = "TANGENT"
    OBJECT = "OBJECT"
    WORLD = "WORLD"


class Compression(StrEnum):
    """The format of the blocks in DDS and KTX2 files. AUTO: what fits each map."""

    AUTO = "AUTO"
    BC4 = "BC4"
    BC5 = "BC5"
    BC6H = "BC6H"
    BC7 = "BC7"


class Format(StrEnum):
    """How the depth, the blocks and the quality of files are chosen. AUTO: the smallest within limits, for each map."""

    FIXED = "FIXED"
    AUTO = "AUTO"


class Hit(StrEnum):
    """Which hit of a ray counts."""

    OWN = "OWN"
    OUTERMOST = "OUTERMOST"
    NEAREST = "NEAREST"


class Directions(StrEnum):
    """The normals of the low mesh that rays follow."""

    BLENDED = "BLENDED"
    SMOOTH = "SMOOTH"
    SPLIT = "SPLIT"


class MarginType(StrEnum):
    """How the margin is filled."""

    EXTEND = "EXTEND"
    ADJACENT_FACES = "ADJACENT_FACES"


class Symmetry(StrEnum):
    """Along which axis of the world a low mesh equals its mirror image. AUTO: what is measured."""

    AUTO = "AUTO"
    NONE = "NONE"
    X = "X"
    Y = "Y"
    Z = "Z"

    @property
    def axes(self) -> tuple[int, ...]:
        """Those that are tried, in this order."""
        return {"AUTO": (0, 1, 2), "NONE": ()}[self] if len(self) > 1 else ("XYZ".index(self),)


class Wrap(StrEnum):
    """Along which axes of the UVs the map is a tile that repeats."""

    NONE = "NONE"
    U = "U"
    V = "V"
    UV = "UV"


class Stacked(StrEnum):
    """The part of a low mesh that the map is made for where several share texels."""

    FIRST = "FIRST"
    LAST = "LAST"


class Modifiers(StrEnum):
    """Which settings of modifiers a bake uses."""

    RENDER = "RENDER"
    VIEWPORT = "VIEWPORT"


class Storage(StrEnum):
    """Where the map is kept."""

    PACK = "PACK"
    FILE = "FILE"
    MEMORY = "MEMORY"


class DistanceUnit(StrEnum):
    """The unit of the distances of maps that cast rays from the high surface."""

    DIAGONAL = "DIAGONAL"
    SCENE = "SCENE"


class Fade(StrEnum):
    """How the shade of an occluder fades towards the occlusion distance."""

    NONE = "NONE"
    LINEAR = "LINEAR"
    SMOOTH = "SMOOTH"


class Occluders(StrEnum):
    """What shades the high objects."""

    OWN = "OWN"
    ALL = "ALL"
    SCENE = "SCENE"


class Axis(StrEnum):
    """An axis of a space."""

    X = "X"
    Y = "Y"
    Z = "Z"


class IdBy(StrEnum):
    """What the parts of the part ID map are."""

    LOOSE_PART = "LOOSE_PART"
    UV_ISLAND = "UV_ISLAND"
    FACE_SET = "FACE_SET"
    COLOR = "COLOR"
    COLLECTION = "COLLECTION"


class ExactMaterials(StrEnum):
    """Whether Cycles evaluates what Imprint does not follow of materials."""

    AUTO = "AUTO"
    OFF = "OFF"


class Pack(StrEnum):
    """Whose layout the packed image has."""

    NONE = "NONE"
    GLTF = "GLTF"
    UNREAL = "UNREAL"
    GODOT = "GODOT"
    URP = "URP"
    HDRP = "HDRP"
    CUSTOM = "CUSTOM"


class VertexDomain(StrEnum):
    """Where attributes of the low mesh receive the maps."""

    NONE = "NONE"
    CORNER = "CORNER"
    POINT = "POINT"
