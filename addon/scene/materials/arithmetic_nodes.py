# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the nodes that compute with constants and at most one texture.

The formulas are those of Blender's source: gpu_shader_common_mix_rgb.glsl, gpu_shader_common_math.glsl and
gpu_shader_material_vector_math.glsl."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from bpy.types import Node

from ...core.material_feeds import LUMINANCE, ImageFeed
from ..textures import UNKNOWN
from .node_values import NodeValues, Place, own_value, title
from .signals import (
    NEGLIGIBLE,
    Function,
    NotAffineError,
    Signal,
    combine,
    component,
    is_image,
    joined,
    limited,
    number,
    scaled,
    to_number,
)


class Operation(NamedTuple):
    """A function, and the numbers of the arguments in which it is affine while the others are constant."""

    function: Function
    affine: frozenset[int] = frozenset()


def _divided(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a / b, and 0 where b is 0."""
    return np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=b != 0.0)


def _soft_light(t: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    screen = 1.0 - (1.0 - b) * (1.0 - a)
    return (1.0 - t) * a + t * ((1.0 - a) * b * a + a * screen)


def _overlay(t: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    dark, light = a * (1.0 - t + 2.0 * t * b), 1.0 - (1.0 - t + 2.0 * t * (1.0 - b)) * (1.0 - a)
    return np.where(a < 0.5, dark, light)


_ALL = frozenset((0, 1, 2))

BLENDING = {
    "MIX": Operation(lambda t, a, b: (1.0 - t) * a + t * b, _ALL),
    "ADD": Operation(lambda t, a, b: a + t * b, _ALL),
    "SUBTRACT": Operation(lambda t, a, b: a - t * b, _ALL),
    "MULTIPLY": Operation(lambda t, a, b: a * (1.0 - t + t * b), _ALL),
    "SCREEN": Operation(lambda t, a, b: 1.0 - (1.0 - t + t * (1.0 - b)) * (1.0 - a), _ALL),
    "LINEAR_LIGHT": Operation(lambda t, a, b: a + t * (2.0 * b - 1.0), _ALL),
    "DIVIDE": Operation(lambda t, a, b: np.where(b == 0.0, a, (1.0 - t) * a + t * _divided(a, b)), frozenset((0, 1))),
    "OVERLAY": Operation(_overlay, frozenset((0, 2))),
    "SOFT_LIGHT": Operation(_soft_light, frozenset((0, 2))),
    "DARKEN": Operation(lambda t, a, b: (1.0 - t) * a + t * np.minimum(a, b), frozenset((0,))),
    "LIGHTEN": Operation(lambda t, a, b: (1.0 - t) * a + t * np.maximum(a, b), frozenset((0,))),
    "DIFFERENCE": Operation(lambda t, a, b: (1.0 - t) * a + t * np.abs(a - b), frozenset((0,))),
}
"""Mix nodes by blend type: functions of the factor, A and B."""

MATH = {
    "ADD": Operation(lambda a, b, c: a + b, frozenset((0, 1))),
    "SUBTRACT": Operation(lambda a, b, c: a - b, frozenset((0, 1))),
    "MULTIPLY": Operation(lambda a, b, c: a * b, frozenset((0, 1))),
    "DIVIDE": Operation(lambda a, b, c: _divided(a, b), frozenset((0,))),
    "MULTIPLY_ADD": Operation(lambda a, b, c: a * b + c, _ALL),
    "RADIANS": Operation(lambda a, b, c: np.radians(a), frozenset((0,))),
    "DEGREES": Operation(lambda a, b, c: np.degrees(a), frozenset((0,))),
    "SQRT": Operation(lambda a, b, c: np.sqrt(np.maximum(a, 0.0))),
    "POWER": Operation(lambda a, b, c: np.where((a < 0.0) & (b != np.floor(b)), 0.0, a**b)),
    "ABSOLUTE": Operation(lambda a, b, c: np.abs(a)),
    "EXPONENT": Operation(lambda a, b, c: np.exp(a)),
    "MINIMUM": Operation(lambda a, b, c: np.minimum(a, b)),
    "MAXIMUM": Operation(lambda a, b, c: np.maximum(a, b)),
    "LESS_THAN": Operation(lambda a, b, c: np.where(a < b, 1.0, 0.0)),
    "GREATER_THAN": Operation(lambda a, b, c: np.where(a > b, 1.0, 0.0)),
    "SIGN": Operation(lambda a, b, c: np.sign(a)),
    "ROUND": Operation(lambda a, b, c: np.floor(a + 0.5)),
    "FLOOR": Operation(lambda a, b, c: np.floor(a)),
    "CEIL": Operation(lambda a, b, c: np.ceil(a)),
    "TRUNC": Operation(lambda a, b, c: np.trunc(a)),
    "FRACT": Operation(lambda a, b, c: a - np.floor(a)),
    "SINE": Operation(lambda a, b, c: np.sin(a)),
    "COSINE": Operation(lambda a, b, c: np.cos(a)),
    "TANGENT": Operation(lambda a, b, c: np.tan(a)),
}
"""Math nodes by operation: functions of three numbers, of which most use fewer."""

VECTOR_MATH = {
    **{name: MATH[name] for name in ("ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "MULTIPLY_ADD")},
    **{name: MATH[name] for name in ("ABSOLUTE", "MINIMUM", "MAXIMUM", "FLOOR", "CEIL")},
    "SCALE": MATH["MULTIPLY"],
}
"""Vector Math nodes by operation: functions of three vectors. The second of SCALE has the scale three times."""


CURVE_SAMPLES = 65
"""At how many places a curve or a ramp is compared with a straight line."""


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
    return limited(scaled(values.input(output, "Color"), 1.0 + contrast, bright - contrast * 0.5), 0.0, np.inf)


def _hue_saturation(values: NodeValues, output: Place) -> Signal:
    hue, saturation, value, factor = (
        values.constant(output, name)[0] for name in ("Hue", "Saturation", "Value", "Fac")
    )
    if factor and (hue != 0.5 or saturation != 1.0):
        raise NotAffineError("changes the hue or the saturation")
    source = values.input(output, "Color")
    if factor and value != 1.0 and (_measured(values, source).bounds[0] < -NEGLIGIBLE).any():
        raise NotAffineError("changes colors below 0")
    return limited(scaled(source, np.full(3, 1.0 - factor + factor * value), np.zeros(3)), 0.0, np.inf)


def _measured(values: NodeValues, signal: Signal) -> Signal:
    """`signal` with the range of the values that its image has. Attributes count as colors, which are at least 0."""
    if signal.range != UNKNOWN:
        return signal
    is_measured = isinstance(signal.feed, ImageFeed)
    measured = values.images.measured_range(signal.feed.image, signal.feed.tiles) if is_measured else (0.0, np.inf)
    return replace(signal, range=measured)


def _math(values: NodeValues, output: Place) -> Signal:
    node = output.node
    parts = [values.input(output, name) for name in ("Value", "Value_001", "Value_002")]
    value = _cut_off(node, parts) or _limit(node.operation, parts) or _product(node, parts[:2])
    value = value or _operation(MATH, node, parts)
    return limited(value, 0.0, 1.0) if node.use_clamp else value


def _vector_math(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if output.socket.identifier != "Vector":
        raise NotAffineError("computes a length or a product of vectors")
    second = "Scale" if node.operation == "SCALE" else "Vector_001"
    parts = [values.input(output, name) for name in ("Vector", second, "Vector_002")]
    return _limit(node.operation, parts) or _product(node, parts[:2]) or _operation(VECTOR_MATH, node, parts)


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
        factor = limited(factor, 0.0, 1.0)
    mixed = _mixed(values, output, factor, names[1:], blending)
    return limited(mixed, 0.0, 1.0) if clamps else mixed


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
    return limited(values.input(output, "Value"), low, high)


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
    mapped = scaled(values.input(output, "Value"), np.full(3, slope), np.full(3, to_low - slope * from_low))
    return limited(mapped, min(to_low, to_high), max(to_low, to_high)) if node.clamp else mapped


def _curves(values: NodeValues, output: Place) -> Signal:
    mapping = output.node.mapping
    mapping.initialize()
    *channels, combined = mapping.curves

    def curve(x: np.ndarray) -> np.ndarray:
        evaluate = mapping.evaluate
        return np.array([evaluate(own, evaluate(combined, v)) for own, v in zip(channels, x, strict=True)])

    factor, source = limited(values.input(output, "Fac"), 0.0, 1.0), values.input(output, "Color")
    places = [point.location[0] for one in mapping.curves for point in (one.points[0], one.points[-1])]
    ends = None if mapping.extend == "EXTRAPOLATED" else (min(places), max(places))
    share = factor.constant
    if share is None:
        return combine(*BLENDING["MIX"], [factor, source, _along(source, curve, ends)])
    if ends and (share < 1.0).any() and source.constant is None and limited(source, *ends) != source:
        raise NotAffineError("changes a texture along a curve")
    return _along(source, lambda x: (1.0 - share) * x + share * curve(x), ends)


def _ramp(values: NodeValues, output: Place) -> Signal:
    ramp, index = output.node.color_ramp, 3 if output.socket.identifier == "Alpha" else slice(3)

    def curve(x: np.ndarray) -> np.ndarray:
        return np.ones(3) * np.array(ramp.evaluate(x[0]))[index]

    return _along(values.input(output, "Fac"), curve, (0.0, 1.0))


def _light_path(values: NodeValues, output: Place) -> Signal:
    name = output.socket.identifier
    if not name.startswith("Is "):
        raise NotAffineError(f"gives {name}")
    return number(1.0 if name == "Is Camera Ray" else 0.0)  # a map shows what a camera sees


def _along(
    source: Signal, curve: Callable[[np.ndarray], np.ndarray], ends: tuple[float, float] | None = None
) -> Signal:
    """`curve` of each channel of a color. Raises NotAffineError for a texture on a curve that is not straight.

    ends: where the curve goes on flat; None if it goes on as it begins and ends.
    """
    if source.constant is not None:
        return combine(curve, set(), [source])
    first, last = ends or (0.0, 1.0)
    at_first, at_last = curve(np.full(3, first)), curve(np.full(3, last))
    slope = (at_last - at_first) / max(last - first, NEGLIGIBLE)
    places = np.linspace(first, last, CURVE_SAMPLES)
    bends = [np.abs(curve(np.full(3, x)) - (at_first + (x - first) * slope)).max() for x in places]
    if max(bends) > NEGLIGIBLE:
        raise NotAffineError("changes a texture along a curve")
    return scaled(limited(source, *ends) if ends else source, slope, at_first - first * slope)


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
    note = f"the node {title(node)} makes steps of a texture, of which the map has the values"
    texture = parts[varying[0]]
    step = 0.5 if count == 1 else float(parts[1 - varying[0]].constant[0])
    texture = replace(texture, notes=(note, *texture.notes), step=step if texture.step is None else None)
    is_falling = (node.operation == "LESS_THAN" and varying == [0]) or (
        node.operation == "GREATER_THAN" and varying == [1]
    )
    return scaled(texture, -np.ones(3), np.ones(3)) if is_falling else texture


def _limit(operation: str, parts: Sequence[Signal]) -> Signal | None:
    """The smaller or the larger one of a texture and a constant; None if this is no such limit."""
    for texture, limit in (parts[:2], parts[1::-1]):
        if texture.constant is None and limit.constant is not None:
            if operation == "MINIMUM":
                return limited(texture, -np.inf, limit.constant).noted(*limit.notes)
            if operation == "MAXIMUM":
                return limited(texture, limit.constant, np.inf).noted(*limit.notes)
    return None


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
