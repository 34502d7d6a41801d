# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the shader that stands for a material: its Principled BSDF, or the shader that comes closest to one."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeAlias

from bpy.types import Material, Node

from .node_values import NodeValues, Place, title
from .signals import NotAffineError, NotFollowedError

PRINCIPLED = "ShaderNodeBsdfPrincipled"
MOST_SHADERS = 30
"""The longest chain of Mix Shader and Add Shader nodes that is followed."""
BASE_COLOR, ROUGHNESS, METALLIC, ALPHA, EMISSION = "Base Color", "Roughness", "Metallic", "Alpha", "Emission Color"
Value: TypeAlias = Place | float
"""An input of a shader, or a constant."""


class Share(NamedTuple):
    """A part in a mix with transparency: the factor of a Mix Shader, or what is left of it to 1."""

    factor: Place
    is_rest: bool


@dataclass(frozen=True)
class Shader:
    """A shader of the surface. values: by socket of the Principled BSDF. strength: of the emission, by which it is multiplied.

    opacity: the shares of the shader in mixes with transparency, whose product is its alpha's factor. notes: clauses of
    sentences. normal: what moves the normals.
    """

    node: Node
    values: dict[str, Value]
    strength: Place | None = None
    normal: Place | None = None
    opacity: tuple[Share, ...] = ()
    notes: tuple[str, ...] = ()


def find_shader(values: NodeValues, material: Material) -> Shader:
    """The shader of the surface, as Cycles and EEVEE show it. Raises NotFollowedError if there is none that can be read."""
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") or tree.get_output_node("EEVEE")
    if output is None:
        raise NotFollowedError("it has no Material Output")
    return _Finder(values).find(Place(output.inputs["Surface"]))


@dataclass
class _Finder:
    """Follows mixes of shaders. It remembers what it has found, because mixes can share shaders."""

    values: NodeValues
    _known: dict[Place, Shader | NotFollowedError] = field(default_factory=dict)
    _depth: int = 0

    def find(self, surface: Place) -> Shader:
        """The shader at an input. Raises NotFollowedError if there is none that can be read."""
        output = self.values.links.source(surface)
        if not output.socket.is_output:
            raise NotFollowedError("a mix of shaders lacks one" if self._depth else "it has no shader")
        if output not in self._known:
            self._known[output] = self._shader(output)
        found = self._known[output]
        if isinstance(found, NotFollowedError):
            raise found
        return found

    def _shader(self, output: Place) -> Shader | NotFollowedError:
        if self._depth > MOST_SHADERS:
            return NotFollowedError(f"more than {MOST_SHADERS} shaders follow each other")
        self._depth += 1
        try:
            match output.node.bl_idname:
                case "ShaderNodeBsdfPrincipled":
                    return _principled(output)
                case "ShaderNodeEmission":
                    return _emission(output)
                case "ShaderNodeMixShader":
                    return self._mixed(output)
                case "ShaderNodeAddShader":
                    places = [output.beside(socket) for socket in output.node.inputs]
                    return self._first(places, f"the node {title(output.node)} adds shaders")
            return _simple(output)
        except NotFollowedError as error:
            return error
        finally:
            self._depth -= 1

    def _mixed(self, output: Place) -> Shader:
        """One of two mixed shaders: the one that the factor chooses, or that is beside a Transparent BSDF, or the first."""
        node = output.node
        factor, first, second = (output.beside(socket) for socket in node.inputs)
        share = self._constant(factor)
        if share is not None and share in (0.0, 1.0):
            return self.find(second if share else first)
        for place, other, is_rest in ((first, second, True), (second, first, False)):
            if self._is_transparent(other):
                found = self.find(place)
                return replace(found, opacity=(*found.opacity, Share(factor, is_rest)))
        return self._first([first, second], f"the node {title(node)} mixes shaders")

    def _first(self, places: Sequence[Place], what: str) -> Shader:
        """The first of several shaders that can be read, and rather a Principled BSDF than another."""
        found, reasons = [], []
        for place in places:
            try:
                found.append(self.find(place))
            except NotFollowedError as error:
                reasons.append(error)
        if not found:
            raise reasons[0]
        chosen = next((one for one in found if one.node.bl_idname == PRINCIPLED), found[0])
        return replace(chosen, notes=(*chosen.notes, f"{what}, of which the maps have {title(chosen.node)}"))

    def _constant(self, factor: Place) -> float | None:
        try:
            value = self.values.read(factor).constant
        except (NotFollowedError, NotAffineError):
            return None
        return None if value is None else float(value[0].clip(0.0, 1.0))

    def _is_transparent(self, surface: Place) -> bool:
        source = self.values.links.source(surface)
        return source.socket.is_output and source.node.bl_idname == "ShaderNodeBsdfTransparent"


def _principled(output: Place) -> Shader:
    inputs = [socket for socket in output.node.inputs if socket.enabled and socket.type in {"RGBA", "VALUE"}]
    sockets: dict[str, Value] = {socket.name: output.beside(socket) for socket in inputs}
    return Shader(output.node, sockets, output.input("Emission Strength"), output.input("Normal"))


def _emission(output: Place) -> Shader:
    color = output.input("Color")
    note = f"the shader {title(output.node)} is no Principled BSDF; its color counts as base color and as emission"
    return Shader(output.node, {BASE_COLOR: color, EMISSION: color}, output.input("Strength"), notes=(note,))


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
    return Shader(node, sockets, None, normal, notes=(note,))
