# SPDX-License-Identifier: GPL-3.0-or-later
"""What feeds the sockets of the high meshes' materials, as plain data: constants, image textures and attributes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

import numpy as np

from .declarations import bases


class Extension(StrEnum):
    """What an image shows outside 0 to 1, as in Blender's Image Texture node."""

    REPEAT = "REPEAT"
    EXTEND = "EXTEND"
    CLIP = "CLIP"
    MIRROR = "MIRROR"


@dataclass(frozen=True)
class Constant:
    """The same value everywhere.

    Attributes:
        color: Red, green, blue and alpha, scene-linear; numbers have three equal channels.
    """

    color: tuple[float, float, float, float]


@dataclass(frozen=True)
class Limits:
    """Limits of what a texture has, before scale and offset.

    Attributes:
        low, high: Of the value, by channel.
        least, most: Of red, green and blue before LUMINANCE or AVERAGE weighs them.
    """

    low: tuple[float, float, float] = (-math.inf, -math.inf, -math.inf)
    high: tuple[float, float, float] = (math.inf, math.inf, math.inf)
    least: float = -math.inf
    most: float = math.inf


NO_LIMITS = Limits()


@dataclass(frozen=True)
class ImageFeed:
    """A value from an image.

    Attributes:
        image: The key that `load_image` takes.
        tiles: UDIM numbers of a tiled image; empty for a single image, which extends by `extension`.
        uv_layer: Empty for each mesh's active render layer.
        mapping: The first two rows of the affine matrix (2, 3) that takes (u, v, 1) to the image's coordinates.
        channel: 0 to 3 for one channel, in which case all three of the value are equal; None for the color; LUMINANCE or
            AVERAGE where a color or a vector feeds a number.
        is_smooth: Linear interpolation, rather than the closest pixel.
        limits, scale, offset: Of the value, after all else and in this order: value * scale + offset.
    """

    image: str
    tiles: tuple[int, ...] = ()
    uv_layer: str = ""
    mapping: tuple[tuple[float, float, float], tuple[float, float, float]] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    extension: Extension = Extension.REPEAT
    channel: int | None = None
    is_smooth: bool = True
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    limits: Limits = NO_LIMITS


@dataclass(frozen=True)
class ImagePixels:
    """The pixels of an image, or of one tile of it.

    Attributes:
        values (h, w, 4) float32: Row 0 at v = 0: scene-linear or data, or with is_srgb as sRGB stores colors.
        is_byte: Whether they are whole steps of 1/255, so that 8 bits hold them.
        weighs_alpha: Whether colors, which are not multiplied with their alpha, count by it where pixels are averaged: what is
            transparent does not color what is beside it.
    """

    values: np.ndarray
    is_srgb: bool = False
    is_byte: bool = False
    weighs_alpha: bool = False


@dataclass(frozen=True)
class AttributeFeed:
    """A value from an attribute of the mesh, of any domain.

    Attributes:
        name: Empty for the color attribute that is set to render. Others as in ImageFeed.
        channel: Which component feeds a number; None for a color.
        scale: What each channel is multiplied by.
        offset: What is added then.
    """

    name: str
    channel: int | None = None
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    limits: Limits = NO_LIMITS


@dataclass(frozen=True)
class ExactFeed:
    """A value that Cycles evaluates at the hits.

    Attributes:
        material: HighMaterial.key.
        socket: Whose value it is.
        layers: The keys of Mesh.layers that its nodes read.
        is_of_object: Whether they read the object, so that the instances of a mesh differ.
        has_bumps: Whether they look at what is a texel away, as Bump nodes do.
        basis: As in NormalMapFeed, of its normal maps.
    """

    material: int
    socket: str
    layers: tuple[tuple[str, str], ...] = ()
    is_of_object: bool = False
    has_bumps: bool = False
    basis: str = bases.CYCLES.name


Feed: TypeAlias = Constant | ImageFeed | AttributeFeed | ExactFeed
LUMINANCE, AVERAGE = -1, -2
"""The `channel` of a color that feeds a number, and that of a vector: the mean of red, green and blue."""
LUMINANCE_WEIGHTS = (0.2126390, 0.7151687, 0.0721923)
"""Red, green and blue of the luminance: Y of linear Rec.709, as Blender's RGB to BW node has it."""


@dataclass(frozen=True)
class NormalMapFeed:
    """A tangent-space normal map of a high mesh.

    Attributes:
        uv_layer: Of its tangents; empty for the active render layer.
        strength: Of the node, from 0 on.
        is_green_down: Whether green stores -Y, as for DirectX.
        basis: By which it is read: Cycles', or on an object that is baked onto itself that of the baked map.
    """

    image: ImageFeed
    uv_layer: str = ""
    strength: float = 1.0
    is_green_down: bool = False
    basis: str = bases.CYCLES.name


@dataclass(frozen=True)
class BumpFeed:
    """A bump map of a high mesh: heights of `distance` scene units for the value 1. It may lie on a normal map.

    Attributes:
        strength: Of the node, from 0 to 1.
    """

    image: ImageFeed
    strength: float = 1.0
    distance: float = 1.0
    below: NormalMapFeed | None = None


DetailFeed: TypeAlias = NormalMapFeed | BumpFeed | ExactFeed
"""The value of an ExactFeed is the normal in world space, stored as normal maps are."""


@dataclass(frozen=True)
class CutOut:
    """Where a material is clear, so that one sees through it: where the feed, a number, is below the threshold."""

    feed: Feed
    threshold: float = 0.5


@dataclass(frozen=True)
class HighMaterial:
    """A material of the high meshes.

    Attributes:
        feeds: By the name of the Principled BSDF's socket, as Blender's interface spells it. The map of a missing socket is not
            known on this material. "Emission Color" includes the strength.
        detail: What moves the normals.
        notes: Sentences about what could not be followed, by socket: "Normal" for `detail`, "" for the whole material.
        key: Tells materials of one name apart.
        cutout: Where it is clear; None if it is solid.
    """

    name: str
    feeds: dict[str, Feed] = field(default_factory=dict)
    detail: DetailFeed | None = None
    notes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    key: int = 0
    cutout: CutOut | None = None
