# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the nodes whose values vary over the surface: images with their coordinates, attributes, and bumps."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from bpy.types import Node
from mathutils import Euler

from ...core.material_feeds import (
    AVERAGE,
    NO_LIMITS,
    AttributeFeed,
    BumpFeed,
    DetailFeed,
    Extension,
    ImageFeed,
    NormalMapFeed,
)
from ..textures import UnreadableError
from .arithmetic_nodes import MATH, VECTOR_MATH, Operation
from .node_values import NodeValues, Place, title
from .signals import NotAffineError, NotFollowedError, Signal

Mapping: TypeAlias = tuple[tuple[float, float, float], tuple[float, float, float]]
MOST_NODES = 60
"""The longest chain of nodes that is followed, because each takes several calls of Python's stack."""


@dataclass(frozen=True)
class _Vector:
    """An affine function of UV coordinates.

    Attributes:
        rows (3, 3): Take (u, v, 1) to it.
        layer: As in feeds; None if it is constant.
    """

    rows: np.ndarray
    layer: str | None = None


def coordinates(values: NodeValues, output: Place) -> tuple[str, Mapping]:
    """The UV layer, as in feeds, and the mapping of an Image Texture node with this output.

    Raises NotFollowedError for coordinates that are no affine function of one UV layer.
    """
    place = output.input("Vector")
    is_linked = values.links.source(place).socket.is_output
    vector = _Reader(values).read(place) if is_linked else _Vector(np.diag((1.0, 1.0, 0.0)), "")
    own = output.node.texture_mapping
    is_moved = any(own.translation) or any(own.rotation) or tuple(own.scale) != (1.0, 1.0, 1.0)
    if is_moved or own.use_min or own.use_max or (own.mapping_x, own.mapping_y) != ("X", "Y"):
        raise NotFollowedError(f"the node {title(output.node)} has a texture mapping of its own")
    if not np.isfinite(vector.rows).all():
        raise NotFollowedError(f"the node {title(output.node)} has coordinates that are not finite")
    first, second = (tuple(map(float, row)) for row in vector.rows[:2])
    return vector.layer or "", (first, second)


@dataclass
class _Reader:
    """Reads the coordinates of one image. It remembers what it has read, because nodes can share inputs."""

    values: NodeValues
    _known: dict[Place, _Vector] = field(default_factory=dict)
    _depth: int = 0

    def read(self, place: Place) -> _Vector:
        """The vector at an input socket; a number three times."""
        source = self.values.links.source(place)
        if not source.socket.is_output:
            return _constant(self.values.read(place).constant)
        vector = self._output(source)
        match source.socket.type, place.socket.type:
            case "VECTOR", "VALUE":
                return _Vector(np.tile(vector.rows.mean(axis=0), (3, 1)), vector.layer)
            case "RGBA", "VALUE":
                raise NotFollowedError(f"the node {title(place.node)} takes a color as a coordinate")
        return vector

    def _output(self, place: Place) -> _Vector:
        if place not in self._known:
            if self._depth == MOST_NODES:
                raise NotFollowedError(f"more than {MOST_NODES} nodes follow each other")
            self._depth += 1
            self._known[place] = self._evaluated(place)
            self._depth -= 1
        return self._known[place]

    def _evaluated(self, output: Place) -> _Vector:
        node, name = output.node, output.socket.identifier
        match node.bl_idname:
            case "ShaderNodeTexCoord" | "ShaderNodeUVMap" | "ShaderNodeAttribute":
                return _Vector(np.diag((1.0, 1.0, 0.0)), _layer(node, name))
            case "ShaderNodeMapping":
                return self._mapped(output)
            case "ShaderNodeSeparateXYZ":
                vector = self.read(output.input("Vector"))
                return _Vector(np.tile(vector.rows["XYZ".index(name)], (3, 1)), vector.layer)
            case "ShaderNodeCombineXYZ":
                return self._joined(output)
            case "ShaderNodeMath" if node.operation in MATH and not node.use_clamp:
                return self._combined(output, MATH[node.operation], ("Value", "Value_001", "Value_002"))
            case "ShaderNodeVectorMath" if node.operation in VECTOR_MATH:
                second = "Scale" if node.operation == "SCALE" else "Vector_001"
                return self._combined(output, VECTOR_MATH[node.operation], ("Vector", second, "Vector_002"))
        constant = self.values.output(output).constant
        if constant is None:
            raise NotFollowedError(f"Imprint cannot follow the coordinates from the node {title(node)}")
        return _constant(constant)

    def _mapped(self, output: Place) -> _Vector:
        location, rotation, scale = (
            self.values.constant(output, name) if name in output.node.inputs else np.zeros(3)
            for name in ("Location", "Rotation", "Scale")
        )
        vector = self.read(output.input("Vector"))
        turn = np.array(Euler(rotation).to_matrix())
        match output.node.vector_type:
            case "POINT" | "VECTOR":  # a vector has no location
                linear, offset = turn * scale, location
            case "TEXTURE":
                inverse = np.divide(1.0, scale, out=np.zeros(3), where=scale != 0.0)
                linear = inverse[:, None] * turn.T
                offset = -linear @ location
            case _:
                raise NotFollowedError(f"the node {title(output.node)} maps normals")
        rows = linear @ vector.rows
        rows[:, 2] += offset
        return _Vector(rows, vector.layer)

    def _joined(self, output: Place) -> _Vector:
        parts = [self.read(output.input(name)) for name in "XYZ"]
        rows = np.stack([part.rows[i] for i, part in enumerate(parts)])
        return _Vector(rows, _same_layer(output.node, parts[:2]))

    def _combined(self, output: Place, operation: Operation, names: Sequence[str]) -> _Vector:
        """An operation, if it is affine in the only argument that varies, or adds or subtracts several."""
        parts = [self.read(output.input(name)) for name in names]
        varying = [i for i, part in enumerate(parts) if part.layer is not None]
        layer = _same_layer(output.node, parts)
        arguments = [part.rows[:, 2] for part in parts]
        if not varying:
            return _constant(operation.function(*arguments))
        is_sum = output.node.operation in {"ADD", "SUBTRACT"}
        if not set(varying) <= operation.affine or (len(varying) > 1 and not is_sum):
            raise NotFollowedError(f"Imprint cannot follow the coordinates from the node {title(output.node)}")
        rows = np.zeros((3, 3))
        rows[:, 2] = operation.function(*arguments)
        for place in varying:
            at_0, at_1 = (
                operation.function(*arguments[:place], np.full(3, end), *arguments[place + 1 :]) for end in (0.0, 1.0)
            )
            rows[:, :2] += (at_1 - at_0)[:, None] * parts[place].rows[:, :2]
        return _Vector(rows, layer)


def _layer(node: Node, output: str) -> str:
    """The UV layer of a node for coordinates. Raises NotFollowedError if its output is another kind of coordinates."""
    if getattr(node, "from_instancer", False):
        raise NotFollowedError(f"the node {title(node)} takes coordinates from the instancer")
    match node.bl_idname:
        case "ShaderNodeTexCoord" if output == "UV":
            return ""
        case "ShaderNodeUVMap":
            return node.uv_map
        case "ShaderNodeAttribute" if node.attribute_type == "GEOMETRY" and output in {"Vector", "Color"}:
            return node.attribute_name
    raise NotFollowedError(f"the node {title(node)} gives {output} coordinates")


def _same_layer(node: Node, parts: Sequence[_Vector]) -> str | None:
    layers = {part.layer for part in parts if part.layer is not None}
    if len(layers) > 1:
        raise NotFollowedError(f"the node {title(node)} combines two UV maps")
    return layers.pop() if layers else None


def _constant(value: np.ndarray) -> _Vector:
    rows = np.zeros((3, 3))
    rows[:, 2] = value
    return _Vector(rows)


ALPHA = 3


def _image(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if node.image is None:
        raise NotFollowedError(f"the node {title(node)} has no image")
    if node.projection != "FLAT":
        raise NotFollowedError(f"the node {title(node)} projects its image")
    # Blender shows colors multiplied with alpha, unless the node's alpha is used.
    is_premultiplied = not values.links.has_use(node.outputs["Alpha"])
    try:
        texture = values.images.texture(node.image, is_premultiplied=is_premultiplied)
    except UnreadableError as error:
        raise NotFollowedError(str(error)) from error
    uv_layer, mapping = coordinates(values, output)
    feed = ImageFeed(
        texture.key,
        tiles=texture.tiles,
        uv_layer=uv_layer,
        mapping=mapping,
        extension=Extension(node.extension),
        channel=ALPHA if output.socket.identifier == "Alpha" else None,
        is_smooth=node.interpolation != "Closest",
    )
    notes = texture.notes
    if node.interpolation in {"Cubic", "Smart"}:
        kind = node.interpolation.lower()
        notes = (*notes, f"the {kind} interpolation of the node {title(node)} is linear in the map")
    return Signal(feed, notes, values.images.range(node.image))


def _color_attribute(values: NodeValues, output: Place) -> Signal:
    return Signal(AttributeFeed(output.node.layer_name, channel=ALPHA if output.socket.identifier == "Alpha" else None))


def _attribute(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if node.attribute_type != "GEOMETRY":
        raise NotFollowedError(f"the node {title(node)} reads an attribute of the object or the scene")
    if not node.attribute_name:
        raise NotFollowedError(f"the node {title(node)} names no attribute")
    channel = {"Alpha": ALPHA, "Fac": AVERAGE}.get(output.socket.identifier)
    return Signal(AttributeFeed(node.attribute_name, channel=channel))


READINGS = {
    "ShaderNodeTexImage": _image,
    "ShaderNodeVertexColor": _color_attribute,
    "ShaderNodeAttribute": _attribute,
}
"""The functions that evaluate an output, by type of node."""


FLAT_COLOR = (0.5, 0.5, 1.0)
"""The color of a normal map without detail."""
MOST_BUMPS = 20
"""The longest chain of Bump nodes that is followed."""
FoundDetail = tuple[DetailFeed | None, tuple[str, ...]]
"""A feed, or None if nothing moves the normals, and clauses about what is left out."""


def read_detail(values: NodeValues, normal: Place, depth: int = 0) -> FoundDetail:
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


def _normal_map(values: NodeValues, output: Place) -> FoundDetail:
    node = output.node
    if node.space != "TANGENT":
        raise NotFollowedError(f"the node {title(node)} is not in tangent space")
    strength = max(0.0, float(values.constant(output, "Strength")[0]))
    signal = values.input(output, "Color")
    if strength == 0.0 or (signal.constant is not None and np.allclose(signal.constant, FLAT_COLOR, atol=0.003)):
        return None, ()
    image = _normal_image(signal, "the normal map")
    is_down = image.scale[1] < 0.0
    if is_down:  # a map for DirectX, whose green channel nodes invert
        scale, offset = list(image.scale), list(image.offset)
        scale[1], offset[1] = -scale[1], 1.0 - offset[1]
        image = replace(image, scale=tuple(scale), offset=tuple(offset))
    is_down ^= getattr(node, "convention", "OPENGL") == "DIRECTX"
    return NormalMapFeed(image, node.uv_map, strength, is_green_down=is_down), signal.notes


def _bump(values: NodeValues, output: Place, depth: int) -> FoundDetail:
    node = output.node
    strength = max(0.0, float(values.constant(output, "Strength")[0]))
    distance = float(values.constant(output, "Distance")[0]) * (-1.0 if node.invert else 1.0)
    signal = values.input(output, "Height")
    below, notes = read_detail(values, output.input("Normal"), depth + 1)
    if strength == 0.0 or distance == 0.0 or signal.constant is not None:
        return below, notes
    image = _normal_image(signal, "the height")
    notes = (*signal.notes, *notes)
    if isinstance(below, BumpFeed):
        notes = (*notes, f"the node {title(node)} lies on another Bump node, which the map does not have")
        below = below.below
    return BumpFeed(image, strength, distance, below), notes


def _normal_image(signal: Signal, role: str) -> ImageFeed:
    if not isinstance(signal.feed, ImageFeed):
        raise NotFollowedError(f"{role} is not an image")
    limits = signal.feed.limits
    shared = replace(NO_LIMITS, low=(limits.low[0],) * 3, high=(limits.high[0],) * 3)
    if limits != shared:
        raise NotFollowedError(f"the channels of {role} have several limits")
    return signal.feed
