# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's Mix, Math and Vector Math nodes compute, and in which of their inputs they are affine.

The formulas are those of Blender's source: gpu_shader_common_mix_rgb.glsl, gpu_shader_common_math.glsl and
gpu_shader_material_vector_math.glsl.
"""

from typing import NamedTuple

import numpy as np

from .signals import Function


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
