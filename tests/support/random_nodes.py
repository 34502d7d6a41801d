# SPDX-License-Identifier: GPL-3.0-or-later
"""Grows random shader trees."""

import contextlib

import bpy

FOLLOWED = [
    "TexImage", "TexImage", "VertexColor", "Attribute", "RGB", "Value", "UVMap", "Mapping", "Math", "VectorMath", "Mix",
    "MixRGB", "Invert", "Gamma", "BrightContrast", "HueSaturation", "SeparateColor", "CombineColor", "SeparateXYZ",
    "CombineXYZ",     "Clamp", "MapRange", "RGBToBW", "ValToRGB", "RGBCurve",
]  # fmt: skip
OTHERS = ["TexNoise", "TexVoronoi", "Fresnel", "LayerWeight", "TexCoord", "NewGeometry", "ObjectInfo", "LightPath", "Bump",
          "NormalMap", "Group", "AmbientOcclusion", "Wavelength", "Blackbody", "VectorRotate", "FloatCurve",
          "Tangent"]  # fmt: skip
SHADERS = ["BsdfPrincipled", "BsdfDiffuse", "BsdfGlossy", "Emission", "BsdfTransparent", "MixShader", "AddShader", "BsdfHair",
           "Holdout", "BsdfGlass", "Background", "ShaderToRGB"]  # fmt: skip


def grow(tree, source, kinds, count, images, *, is_sound=False):
    """Add random nodes with random settings and values, linked at random to nodes before them.

    is_sound: whether all links are valid: Cycles takes 0 for others.
    """
    groups = [group for group in bpy.data.node_groups if group != tree]
    for _ in range(count):
        node = tree.nodes.new(f"ShaderNode{source.choice(kinds)}")
        for prop in node.bl_rna.properties:
            if prop.type == "ENUM" and not prop.is_readonly and prop.identifier not in {"bl_icon", "color_tag"}:
                with contextlib.suppress(TypeError):  # a value that shader nodes do not have
                    setattr(node, prop.identifier, source.choice([item.identifier for item in prop.enum_items] or [""]))
        settle(node, source)
        if node.bl_idname == "ShaderNodeTexImage":
            node.image = source.choice([*images, None] if source.random() < 0.1 else images)
            node.interpolation = "Closest"
        elif node.bl_idname == "ShaderNodeVertexColor":
            node.layer_name = source.choice(["paint", "paint", "missing"])
        elif node.bl_idname == "ShaderNodeAttribute":
            node.attribute_name = source.choice(["paint", "UVMap"])
            node.attribute_type = "GEOMETRY"
        elif node.bl_idname == "ShaderNodeGroup" and groups:
            node.node_tree = source.choice(groups)
        for socket in node.inputs:
            randomize(socket, source)
            outputs = [output for other in tree.nodes if other != node for output in other.outputs]
            if is_sound:
                outputs = [output for output in outputs if output.enabled and output.type != "SHADER"]
            if outputs and source.random() < (0.3 if node.bl_idname == "ShaderNodeTexImage" else 0.6):
                tree.links.new(source.choice(outputs), socket).is_muted = source.random() < 0.05
        node.mute = source.random() < 0.05


def settle(node, source):
    """Mostly settings that feeds can express."""
    likely = {
        "operation": ["ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "MULTIPLY_ADD"],
        "blend_type": ["MIX", "ADD", "MULTIPLY", "SCREEN"],
        "projection": ["FLAT"],
        "mode": ["RGB"],
    }
    for name, choices in likely.items():
        if hasattr(node, name) and source.random() < 0.8:
            setattr(node, name, source.choice(choices))


def randomize(socket, source):
    if socket.type == "VALUE":
        socket.default_value = source.choice([0.0, 1.0, source.random(), source.uniform(-2, 2)])
    elif socket.type == "VECTOR" and len(socket.default_value) == 3:
        socket.default_value = [source.uniform(-2, 2) for _ in range(3)]
    elif socket.type == "RGBA":
        socket.default_value = [source.random() for _ in range(4)]
