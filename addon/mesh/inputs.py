# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes that a bake works on."""

from dataclasses import dataclass

import numpy as np

from .triangle_mesh import Mesh


@dataclass(frozen=True)
class Meshes:
    """What a bake works on.

    low: as rays and checks see it, with its faces. basis: the low mesh with tangents, for tangent space, else None.
    directions (C, 3) float32: by corner of `low`, away from its surface. cage: with the corners of `low`, or None.
    is_own_base: the high mesh is the low object's own surface with modifiers. materials: what the labels of the high
    meshes stand for, from 1. shown: a surface on its own base as it is shown, with the UVs that modifiers have moved;
    None where none does.
    """

    low: Mesh
    highs: list[Mesh]
    basis: Mesh | None
    directions: np.ndarray
    cage: Mesh | None
    uv_layer: str
    is_own_base: bool
    materials: list[str]
    shown: Mesh | None = None
