# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads what moves the normals of a shader: Normal Map and Bump nodes."""

from dataclasses import replace

import numpy as np

from ...core.material_feeds import NO_LIMITS, BumpFeed, DetailFeed, ImageFeed, NormalMapFeed
from .node_values import NodeValues, Place, title
from .signals import NotAffineError, NotFollowedError, Signal

FLAT = (0.5, 0.5, 1.0)
"""The color of a normal map without detail."""
MOST_BUMPS = 20
"""The longest chain of Bump nodes that is followed."""
Found = tuple[DetailFeed | None, tuple[str, ...]]
"""A feed, or None if nothing moves the normals, and clauses about what is left out."""


def read_detail(values: NodeValues, normal: Place, depth: int = 0) -> Found:
    """What feeds the Normal input of a shader or a Bump node. Raises NotFollowedError for what no feed can express."""
    source = values.links.source(normal)
    if not source.socket.is_output:
        return None, ()
    node = source.node
    try:
        match node.bl_idname:
            case "ShaderNodeNormalMap":
                return _normal_map(values, source)
            case "ShaderNodeBump" if depth < MOST_BUMPS:
                return _bump(values, source, depth)
            case "ShaderNodeNewGeometry" if source.socket.identifier == "Normal":
                return None, ()
    except NotAffineError as error:
        raise NotFollowedError(f"the node {title(node)} {error}") from error
    raise NotFollowedError(f"Imprint cannot follow the node {title(node)}")


def _normal_map(values: NodeValues, output: Place) -> Found:
    node = output.node
    if node.space != "TANGENT":
        raise NotFollowedError(f"the node {title(node)} is not in tangent space")
    strength = max(0.0, float(values.constant(output, "Strength")[0]))
    signal = values.input(output, "Color")
    if strength == 0.0 or (signal.constant is not None and np.allclose(signal.constant, FLAT, atol=0.003)):
        return None, ()
    image = _image(signal, "the normal map")
    is_down = image.scale[1] < 0.0
    if is_down:  # a map for DirectX, whose green channel nodes invert
        scale, offset = list(image.scale), list(image.offset)
        scale[1], offset[1] = -scale[1], 1.0 - offset[1]
        image = replace(image, scale=tuple(scale), offset=tuple(offset))
    is_down ^= getattr(node, "convention", "OPENGL") == "DIRECTX"
    return NormalMapFeed(image, node.uv_map, strength, is_green_down=is_down), signal.notes


def _bump(values: NodeValues, output: Place, depth: int) -> Found:
    node = output.node
    strength = max(0.0, float(values.constant(output, "Strength")[0]))
    distance = float(values.constant(output, "Distance")[0]) * (-1.0 if node.invert else 1.0)
    signal = values.input(output, "Height")
    below, notes = read_detail(values, output.input("Normal"), depth + 1)
    if strength == 0.0 or distance == 0.0 or signal.constant is not None:
        return below, notes
    image = _image(signal, "the height")
    notes = (*signal.notes, *notes)
    if isinstance(below, BumpFeed):
        notes = (*notes, f"the node {title(node)} lies on another Bump node, which the map does not have")
        below = below.below
    return BumpFeed(image, strength, distance, below), notes


def _image(signal: Signal, role: str) -> ImageFeed:
    if not isinstance(signal.feed, ImageFeed):
        raise NotFollowedError(f"{role} is not an image")
    limits = signal.feed.limits
    shared = replace(NO_LIMITS, low=(limits.low[0],) * 3, high=(limits.high[0],) * 3)
    if limits != shared:
        raise NotFollowedError(f"the channels of {role} have several limits")
    return signal.feed
