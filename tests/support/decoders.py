# SPDX-License-Identifier: GPL-3.0-or-later
"""How programs decode a tangent-space normal, in float64, written down program by program. Shares no code with the shaders
and asks no declaration for its rules."""

import numpy as np

from tests.support.raster import unit


def bitangents(normals, tangents):
    """Of vertices, or of corners: (..., 3) from normals (..., 3) and tangents (..., 4)."""
    return tangents[..., 3:] * np.cross(normals, tangents[..., :3])


def cycles(normal, tangent, _bitangent):
    """svm_node_normal_map: the interpolated normal is normalized, the tangent is not."""
    normal = unit(normal)
    return tangent[..., :3], bitangents(normal, tangent), normal


def mikktspace(normal, tangent, _bitangent):
    """EEVEE, Unreal Engine, Unity URP: the bitangent in the pixel shader, and nothing normalized."""
    return tangent[..., :3], bitangents(normal, tangent), normal


def mikktspace_vertex(normal, tangent, bitangent):
    """mikktspace.h: vNout = normalize(vNt.x * vT + vNt.y * vB + vNt.z * vN), all three as the rasterizer has them."""
    return tangent[..., :3], bitangent, normal


def normalized(normal, tangent, bitangent):
    """three.js: mat3(normalize(vTangent), normalize(vBitangent), normalize(vNormal))."""
    return unit(tangent[..., :3]), unit(bitangent), unit(normal)


DECODERS = {
    "CYCLES": cycles,
    "MIKKTSPACE": mikktspace,
    "MIKKTSPACE_VERTEX": mikktspace_vertex,
    "NORMALIZED": normalized,
}
"""By the basis of a map."""


def decoded(normals, basis, normal, tangent, bitangent):
    """Normals (N, 3), not of length one, that an engine of `basis` shows of tangent-space ones (N, 3).

    normal (N, 3), tangent (N, 4), bitangent (N, 3): of the mesh's corners, interpolated.
    """
    axes = DECODERS[basis](normal, tangent, bitangent)
    return sum(normals[..., i : i + 1] * axis for i, axis in enumerate(axes))
