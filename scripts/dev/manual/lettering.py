# SPDX-License-Identifier: GPL-3.0-or-later
"""Words in the renders of the manual."""

import bpy
import numpy as np

from scripts.dev.manual import models


def letter(words: str, place: tuple[float, float, float], size: float) -> bpy.types.Object:
    """Words that face a camera on -Y, lit by nothing."""
    text = bpy.data.curves.new(words, "FONT")
    text.body, text.align_x, text.size = words, "CENTER", size
    glow = bpy.data.materials.new(words)
    shader = next(node for node in glow.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (0, 0, 0, 1)
    shader.inputs["Emission Color"].default_value = (0.85, 0.85, 0.85, 1)
    shader.inputs["Emission Strength"].default_value = 1.0
    text.materials.append(glow)
    obj = models.add(words, text)
    obj.location, obj.rotation_euler = place, (np.pi / 2, 0, 0)
    obj.visible_shadow = False
    return obj
