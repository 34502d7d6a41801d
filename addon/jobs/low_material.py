# SPDX-License-Identifier: GPL-3.0-or-later
"""The material of a new low mesh: with the values of the high objects' material that no map shows, as its roughness."""

from collections import Counter
from collections.abc import Sequence

import bpy
import numpy as np

from .. import older_blender
from ..core import foreach
from ..scene.materials import material_reading
from ..scene.materials.material_reading import EMISSION

STRENGTH = "Emission Strength"
"""The input that is multiplied with the color of the emission."""


def new_like(highs: Sequence[bpy.types.Object], name: str) -> bpy.types.Material:
    """A material with the constants of the one that most faces of high objects wear, which maps may replace."""
    made = bpy.data.materials.new(name)
    older_blender.switch_on_nodes(made)
    (shader,) = (node for node in made.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    worn = _most_worn(highs)
    constants = material_reading.constants(worn) if worn is not None else {}
    constants.pop(STRENGTH, None)
    if EMISSION in constants:
        constants[STRENGTH] = np.ones(3) if constants[EMISSION].any() else np.zeros(3)
    for socket in shader.inputs:
        if socket.name in constants:
            value = constants[socket.name]
            socket.default_value = (*value, 1.0) if socket.type == "RGBA" else float(value[0])
    return made


def _most_worn(highs: Sequence[bpy.types.Object]) -> bpy.types.Material | None:
    """The material of the most faces; None if most have none."""
    faces: Counter[bpy.types.Material | None] = Counter()
    for high in highs:
        if high.type != "MESH":
            continue
        slots = [slot.material for slot in high.material_slots] or [None]
        numbers = foreach.read(high.data.polygons, "material_index").clip(0, len(slots) - 1)
        for slot, count in enumerate(np.bincount(numbers, minlength=len(slots)).tolist()):
            faces[slots[slot]] += count
    return faces.most_common(1)[0][0] if faces else None
