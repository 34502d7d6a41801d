# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the shader that stands for a material: its Principled BSDF, or the shader that comes closest to one."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from bpy.types import Material, Node

from .node_links import Place, title
from .node_values import NodeValues
from .signals import NotAffineError, NotFollowedError, Signal, scaled

MOST_SHADERS = 30
"""The longest chain of Mix Shader and Add Shader nodes that is followed."""
BASE_COLOR, ROUGHNESS, METALLIC, ALPHA, EMISSION = "Base Color", "Roughness", "Metallic", "Alpha", "Emission Color"
Value: TypeAlias = Place | float
"""An input of a shader, or a constant."""


@dataclass
class Shader:
    """A shader of the surface. values: by socket of the Principled BSDF. strength: of the emission, by which it is multiplied.

    opacity: the share of the shader in a mix with transparency. notes: clauses of sentences. normal: what moves the normals.
    """

    node: Node
    values: dict[str, Value]
    strength: Place | None = None
    normal: Place | None = None
    opacity: Callable[[], Signal] | None = None
    notes: list[str] = field(default_factory=list)


def find_shader(values: NodeValues, material: Material) -> Shader:
    """The shader of the surface, as Cycles and EEVEE show it. Raises NotFollowedError if there is none that can be read."""
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") or tree.get_output_node("EEVEE")
    if output is None:
        raise NotFollowedError("it has no Material Output")
    return _shader(values, Place(output.inputs["Surface"]), 0)


def _shader(values: NodeValues, surface: Place, depth: int) -> Shader:
    source = values.links.source(surface)
    if not source.socket.is_output:
        raise NotFollowedError("it has no shader" if depth == 0 else "a mix of shaders lacks one")
    output, node = source, source.node
    if depth > MOST_SHADERS:
        raise NotFollowedError(f"more than {MOST_SHADERS} shaders follow each other")
    match node.bl_idname:
        case "ShaderNodeBsdfPrincipled":
            return _principled(output)
        case "ShaderNodeEmission":
            color = output.input("Color")
            note = f"the shader {title(node)} is no Principled BSDF; its color counts as base color and as emission"
            return Shader(node, {BASE_COLOR: color, EMISSION: color}, output.input("Strength"), notes=[note])
        case "ShaderNodeMixShader":
            return _mixed(values, output, depth)
        case "ShaderNodeAddShader":
            return _added(values, output, depth)
    return _simple(output)


def _principled(output: Place) -> Shader:
    inputs = [socket for socket in output.node.inputs if socket.enabled and socket.type in {"RGBA", "VALUE"}]
    sockets: dict[str, Value] = {socket.name: output.beside(socket) for socket in inputs}
    return Shader(output.node, sockets, output.input("Emission Strength"), output.input("Normal"))


def _simple(output: Place) -> Shader:
    """A shader with a color: Diffuse, Glossy and their like. Raises NotFollowedError for another."""
    node = output.node
    names = {socket.identifier for socket in node.inputs}
    color = next((name for name in ("Color", "Base Color") if name in names), None)
    if color is None or not node.bl_idname.startswith("ShaderNodeBsdf"):
        raise NotFollowedError(f"Imprint cannot follow the shader {title(node)}")
    is_metal = node.bl_idname in {"ShaderNodeBsdfGlossy", "ShaderNodeBsdfAnisotropic", "ShaderNodeBsdfMetallic"}
    # The roughness of a Diffuse BSDF is another quantity: all of them scatter light evenly.
    has_roughness = "Roughness" in names and node.bl_idname != "ShaderNodeBsdfDiffuse"
    sockets: dict[str, Value] = {
        BASE_COLOR: output.input(color),
        METALLIC: 1.0 if is_metal else 0.0,
        ROUGHNESS: output.input("Roughness") if has_roughness else 1.0,
        ALPHA: 0.0 if node.bl_idname == "ShaderNodeBsdfTransparent" else 1.0,
    }
    note = f"the shader {title(node)} is no Principled BSDF; its color counts as base color"
    normal = output.input("Normal") if "Normal" in names else None
    return Shader(node, sockets, None, normal, notes=[note])


def _mixed(values: NodeValues, output: Place, depth: int) -> Shader:
    """One of two mixed shaders: the one beside a Transparent BSDF, or the one that the factor chooses, or the first."""
    node = output.node
    factor, *places = (output.beside(socket) for socket in node.inputs)
    share = _constant_share(values, factor)
    if share is not None and share in (0.0, 1.0):
        return _shader(values, places[int(share)], depth + 1)
    for place, other, is_second in ((*places, False), (*places[::-1], True)):
        if _is_transparent(values, other):
            found = _shader(values, place, depth + 1)
            outer = found.opacity

            def opacity(outer=outer, is_second=is_second) -> Signal:
                own = values.read(factor)
                own = own if is_second else scaled(own, -np.ones(3), np.ones(3))
                inner = outer().constant if outer else np.ones(3)
                if inner is None:
                    raise NotAffineError("mixes transparency twice")
                return scaled(own, inner, np.zeros(3))

            found.opacity = opacity
            return found
    return _first(values, places, f"the node {title(node)} mixes shaders", depth)


def _added(values: NodeValues, output: Place, depth: int) -> Shader:
    places = [output.beside(socket) for socket in output.node.inputs]
    return _first(values, places, f"the node {title(output.node)} adds shaders", depth)


def _first(values: NodeValues, places: list[Place], what: str, depth: int) -> Shader:
    """The first of two shaders that can be read, and rather a Principled BSDF than another."""
    found = []
    for place in places:
        try:
            found.append(_shader(values, place, depth + 1))
        except NotFollowedError as error:
            reason = error
    if not found:
        raise reason
    chosen = next((one for one in found if one.node.bl_idname == "ShaderNodeBsdfPrincipled"), found[0])
    chosen.notes.append(f"{what}, of which the maps have {title(chosen.node)}")
    return chosen


def _constant_share(values: NodeValues, factor: Place) -> float | None:
    try:
        value = values.read(factor).constant
    except (NotFollowedError, NotAffineError):
        return None
    return None if value is None else float(value[0].clip(0.0, 1.0))


def _is_transparent(values: NodeValues, surface: Place) -> bool:
    source = values.links.source(surface)
    return source.socket.is_output and source.node.bl_idname == "ShaderNodeBsdfTransparent"
