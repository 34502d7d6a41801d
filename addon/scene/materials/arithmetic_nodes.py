# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the nodes that compute with constants and at most one texture."""

from collections.abc import Callable, Sequence

import numpy as np
from bpy.types import Node

from ...core.material_feeds import LUMINANCE
from .node_links import Place, title
from .node_values import NodeValues, own_value
from .operations import BLENDING, MATH, VECTOR_MATH
from .signals import (
    NotAffineError,
    Signal,
    combine,
    component,
    is_image,
    joined,
    number,
    scaled,
    to_number,
)

CURVE_SAMPLES = np.linspace(0.0, 1.0, 65)
"""Where a curve or a ramp is compared with a straight line."""
CURVE_TOLERANCE = 1e-3
"""Largest distance of a curve from a straight line: a quarter of a level of 8 bits."""


def _own(values: NodeValues, output: Place) -> Signal:
    return own_value(output.socket)


def _separate(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if getattr(node, "mode", "RGB") != "RGB":
        raise NotAffineError(f"separates {node.mode}")
    names = ("X", "Y", "Z") if node.bl_idname == "ShaderNodeSeparateXYZ" else ("Red", "Green", "Blue")
    source = values.input(output, node.inputs[0].identifier)
    return component(source, names.index(output.socket.identifier))


def _combine(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if getattr(node, "mode", "RGB") != "RGB":
        raise NotAffineError(f"combines {node.mode}")
    return joined([values.input(output, socket.identifier) for socket in node.inputs])


def _to_gray(values: NodeValues, output: Place) -> Signal:
    return to_number(values.input(output, "Color"), LUMINANCE)


def _invert(values: NodeValues, output: Place) -> Signal:
    parts = [values.input(output, name) for name in ("Fac", "Color")]
    return combine(lambda t, a: (1.0 - t) * a + t * (1.0 - a), {0, 1}, parts)


def _gamma(values: NodeValues, output: Place) -> Signal:
    gamma = values.constant(output, "Gamma")[0]
    source = values.input(output, "Color")
    if gamma == 1.0:
        return source
    return combine(lambda a: np.where(a > 0.0, np.maximum(a, 0.0) ** gamma, a), set(), [source])


def _bright_contrast(values: NodeValues, output: Place) -> Signal:
    bright, contrast = (values.constant(output, name) for name in ("Bright", "Contrast"))
    return _at_least_0(scaled(values.input(output, "Color"), 1.0 + contrast, bright - contrast * 0.5))


def _hue_saturation(values: NodeValues, output: Place) -> Signal:
    hue, saturation, value, factor = (
        values.constant(output, name)[0] for name in ("Hue", "Saturation", "Value", "Fac")
    )
    if factor and (hue != 0.5 or saturation != 1.0):
        raise NotAffineError("changes the hue or the saturation")
    return scaled(values.input(output, "Color"), np.full(3, 1.0 - factor + factor * value), np.zeros(3))


def _math(values: NodeValues, output: Place) -> Signal:
    node = output.node
    parts = [values.input(output, name) for name in ("Value", "Value_001", "Value_002")]
    found = _cut_off(node, parts) or _limited(node.operation, parts) or _product(node, parts[:2])
    found = found or _operation(MATH, node, parts)
    return _clamped(found) if node.use_clamp else found


def _vector_math(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if output.socket.identifier != "Vector":
        raise NotAffineError("computes a length or a product of vectors")
    second = "Scale" if node.operation == "SCALE" else "Vector_001"
    parts = [values.input(output, name) for name in ("Vector", second, "Vector_002")]
    return _product(node, parts[:2]) or _operation(VECTOR_MATH, node, parts)


def _mix(values: NodeValues, output: Place) -> Signal:
    """The Mix node, and its older form for colors."""
    node = output.node
    if node.bl_idname == "ShaderNodeMixRGB":
        names, blending, clamps_factor, clamps = ("Fac", "Color1", "Color2"), node.blend_type, True, node.use_clamp
    elif node.data_type == "ROTATION":
        raise NotAffineError("mixes rotations")
    else:
        kind = {"FLOAT": "Float", "VECTOR": "Vector", "RGBA": "Color"}[node.data_type]
        factor = "Factor_Vector" if kind == "Vector" and node.factor_mode == "NON_UNIFORM" else "Factor_Float"
        names, blending = (factor, f"A_{kind}", f"B_{kind}"), node.blend_type if kind == "Color" else "MIX"
        clamps_factor, clamps = node.clamp_factor, node.clamp_result and kind == "Color"
    factor = values.input(output, names[0])
    if clamps_factor:
        factor = _clamped(factor)
    found = _mixed(values, output, factor, names[1:], blending)
    return _clamped(found) if clamps else found


def _mixed(values: NodeValues, output: Place, factor: Signal, names: Sequence[str], blending: str) -> Signal:
    if blending not in BLENDING:
        raise NotAffineError(f"blends by {blending.replace('_', ' ').title()}")
    share = factor.constant
    # An input that has no influence may come from nodes that cannot be followed.
    if share is not None and not share.any():
        return values.input(output, names[0])
    if share is not None and (share == 1.0).all() and blending == "MIX":
        return values.input(output, names[1])
    colors = [values.input(output, name) for name in names]
    product = _product(output.node, colors, blending) if share is not None else None
    return product or combine(*BLENDING[blending], [factor, *colors])


def _clamp(values: NodeValues, output: Place) -> Signal:
    low, high = (values.constant(output, name)[0] for name in ("Min", "Max"))
    if output.node.clamp_type == "RANGE" and low > high:
        low, high = high, low
    return _clamped(values.input(output, "Value"), low, high)


def _map_range(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if node.data_type != "FLOAT" or node.interpolation_type != "LINEAR":
        raise NotAffineError("maps a range by steps or vectors")
    from_low, from_high, to_low, to_high = (
        values.constant(output, name)[0] for name in ("From Min", "From Max", "To Min", "To Max")
    )
    if from_low == from_high:
        raise NotAffineError("maps an empty range")
    slope = (to_high - to_low) / (from_high - from_low)
    found = scaled(values.input(output, "Value"), np.full(3, slope), np.full(3, to_low - slope * from_low))
    return _clamped(found, min(to_low, to_high), max(to_low, to_high)) if node.clamp else found


def _curves(values: NodeValues, output: Place) -> Signal:
    node = output.node
    node.mapping.initialize()
    *channels, combined = node.mapping.curves

    def curve(x: np.ndarray) -> np.ndarray:
        evaluate = node.mapping.evaluate
        return np.array([evaluate(own, evaluate(combined, v)) for own, v in zip(channels, x, strict=True)])

    factor, source = _clamped(values.input(output, "Fac")), values.input(output, "Color")
    share = factor.constant
    if share is None:
        return combine(*BLENDING["MIX"], [factor, source, _along(source, curve)])
    return _along(source, lambda x: (1.0 - share) * x + share * curve(x))


def _ramp(values: NodeValues, output: Place) -> Signal:
    ramp, index = output.node.color_ramp, 3 if output.socket.identifier == "Alpha" else slice(3)

    def curve(x: np.ndarray) -> np.ndarray:
        return np.ones(3) * np.array(ramp.evaluate(x[0]))[index]

    return _along(values.input(output, "Fac"), curve)


def _light_path(values: NodeValues, output: Place) -> Signal:
    name = output.socket.identifier
    if not name.startswith("Is "):
        raise NotAffineError(f"gives {name}")
    return number(1.0 if name == "Is Camera Ray" else 0.0)  # a map shows what a camera sees


def _along(source: Signal, curve: Callable[[np.ndarray], np.ndarray]) -> Signal:
    """`curve` of each channel of a color from 0 to 1. Raises NotAffineError for a texture on a curve that is not straight."""
    if source.constant is not None:
        return combine(curve, set(), [source])
    at_0, at_1 = curve(np.zeros(3)), curve(np.ones(3))
    bends = [np.abs(curve(np.full(3, x)) - (at_0 + x * (at_1 - at_0))).max() for x in CURVE_SAMPLES]
    if max(bends) > CURVE_TOLERANCE:
        raise NotAffineError("changes a texture along a curve")
    return scaled(source, at_1 - at_0, at_0)


def _operation(table: dict, node: Node, parts: Sequence[Signal]) -> Signal:
    if node.operation not in table:
        raise NotAffineError(f"computes {node.operation.replace('_', ' ').title()}")
    return combine(*table[node.operation], parts)


def _product(node: Node, parts: Sequence[Signal], kind: str = "") -> Signal | None:
    """The better known factor of a product of two textures, with a note; None if this is no such product."""
    if (kind or node.operation) != "MULTIPLY" or any(part.constant is not None for part in parts):
        return None
    chosen = next(filter(is_image, parts), parts[0])
    taken = "the image" if is_image(chosen) else "the first of them"
    return chosen.noted(f"the node {title(node)} multiplies two textures, of which the map has {taken}")


def _cut_off(node: Node, parts: Sequence[Signal]) -> Signal | None:
    """The texture of which a node makes 0 and 1, with a note; None if this is no such node."""
    count = {"LESS_THAN": 2, "GREATER_THAN": 2, "ROUND": 1}.get(node.operation, 0)
    varying = [i for i, part in enumerate(parts[:count]) if part.constant is None]
    if len(varying) != 1:
        return None
    texture = parts[varying[0]].noted(
        f"the node {title(node)} makes steps of a texture, of which the map has the values"
    )
    is_falling = (node.operation == "LESS_THAN" and varying == [0]) or (
        node.operation == "GREATER_THAN" and varying == [1]
    )
    return scaled(texture, -np.ones(3), np.ones(3)) if is_falling else texture


def _limited(operation: str, parts: Sequence[Signal]) -> Signal | None:
    """The texture that a limit does not change, within 0 to 1; None if this is no such limit."""
    for texture, limit in (parts[:2], parts[1::-1]):
        if texture.constant is None and limit.constant is not None:
            low, high = texture.bounds
            if operation == "MINIMUM" and (high <= limit.constant).all():
                return texture
            if operation == "MAXIMUM" and (low >= limit.constant).all():
                return texture
    return None


def _clamped(signal: Signal, low: float = 0.0, high: float = 1.0) -> Signal:
    """`signal` limited to a range. Raises NotAffineError for a texture that leaves it."""
    if signal.constant is not None:
        return combine(lambda a: np.minimum(np.maximum(a, low), high), set(), [signal])
    smallest, largest = signal.bounds
    if (smallest < low - CURVE_TOLERANCE).any() or (largest > high + CURVE_TOLERANCE).any():
        return signal.noted("Blender clamps its values, the map does not")
    return signal


def _at_least_0(signal: Signal) -> Signal:
    return _clamped(signal, 0.0, np.inf)


READINGS = {
    "ShaderNodeRGB": _own,
    "ShaderNodeValue": _own,
    "ShaderNodeSeparateColor": _separate,
    "ShaderNodeSeparateXYZ": _separate,
    "ShaderNodeCombineColor": _combine,
    "ShaderNodeCombineXYZ": _combine,
    "ShaderNodeRGBToBW": _to_gray,
    "ShaderNodeInvert": _invert,
    "ShaderNodeGamma": _gamma,
    "ShaderNodeBrightContrast": _bright_contrast,
    "ShaderNodeHueSaturation": _hue_saturation,
    "ShaderNodeMath": _math,
    "ShaderNodeVectorMath": _vector_math,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix,
    "ShaderNodeClamp": _clamp,
    "ShaderNodeMapRange": _map_range,
    "ShaderNodeRGBCurve": _curves,
    "ShaderNodeValToRGB": _ramp,
    "ShaderNodeLightPath": _light_path,
}
"""The functions that evaluate an output, by type of node."""
