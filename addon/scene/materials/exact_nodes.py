# SPDX-License-Identifier: GPL-3.0-or-later
"""Which sockets Cycles can evaluate at single points of a surface, and what of the mesh their nodes read."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import bpy

from ...core.material_feeds import ExactFeed
from ...mesh.triangle_mesh import ATTRIBUTE, GENERATED, TANGENTS, UV_LAYER
from .. import addons, render_view
from ..textures import UnreadableError
from .node_values import NodeValues, Place, title
from .signals import NotFollowedError


def has_cycles() -> bool:
    """Whether Cycles is enabled in this Blender. Loads it if need be."""
    if "cycles" not in bpy.types.Scene.bl_rna.properties:
        render_view.outside(addons.load)
    return "cycles" in bpy.types.Scene.bl_rna.properties


_PLAIN = {
    *("ShaderNodeRGB", "ShaderNodeValue", "ShaderNodeBlackbody", "ShaderNodeWavelength", "ShaderNodeNormal"),
    *("ShaderNodeValToRGB", "ShaderNodeRGBCurve", "ShaderNodeVectorCurve", "ShaderNodeFloatCurve", "ShaderNodeMix"),
    *("ShaderNodeMixRGB", "ShaderNodeMath", "ShaderNodeVectorMath", "ShaderNodeMapRange", "ShaderNodeClamp"),
    *("ShaderNodeMapping", "ShaderNodeVectorRotate", "ShaderNodeGamma", "ShaderNodeBrightContrast", "ShaderNodeInvert"),
    *("ShaderNodeHueSaturation", "ShaderNodeRGBToBW", "ShaderNodeCombineColor", "ShaderNodeSeparateColor"),
    *("ShaderNodeCombineXYZ", "ShaderNodeSeparateXYZ", "ShaderNodeCombineRGB", "ShaderNodeSeparateRGB"),
    *("ShaderNodeCombineHSV", "ShaderNodeSeparateHSV", "ShaderNodeTexWhiteNoise"),
    *("ShaderNodeBump", "ShaderNodeNormalMap", "ShaderNodeDisplacement"),
}
"""Nodes whose outputs depend on their inputs alone."""
_TEXTURES = {
    *("ShaderNodeTexNoise", "ShaderNodeTexVoronoi", "ShaderNodeTexWave", "ShaderNodeTexMagic", "ShaderNodeTexGabor"),
    *("ShaderNodeTexChecker", "ShaderNodeTexBrick", "ShaderNodeTexGradient", "ShaderNodeTexMusgrave"),
    "ShaderNodeTexEnvironment",
}
"""Those that take generated coordinates where nothing feeds their vector."""
_OUTPUTS = {
    "ShaderNodeTexCoord": {"Generated", "UV", "Object", "Normal"},
    "ShaderNodeNewGeometry": {"Position", "Normal", "True Normal", "Backfacing"},
    "ShaderNodeObjectInfo": {"Location", "Color", "Alpha", "Object Index", "Material Index"},
}
"""Outputs of other nodes that are known at a point. The rest looks at the view, at light, or at the mesh around the point."""


_OF_VIEW = {
    *("ShaderNodeFresnel", "ShaderNodeLayerWeight", "ShaderNodeLightPath", "ShaderNodeCameraData"),
    *("Backfacing", "Incoming", "Camera", "Window", "Reflection"),
}
"""Nodes, and outputs of other nodes, that look at who looks at the surface."""
_PLACED = {"ShaderNodeTexImage", "ShaderNodeVertexColor", "ShaderNodeAttribute"}
"""Nodes that put values at places of a surface."""


def _sources(values: NodeValues, first: Place, seen: set[Place]) -> Iterator[Place]:
    """The outputs on which an input depends that are not `seen` yet, each before those that feed it."""
    waiting = [first]
    while waiting:
        output = values.links.source(waiting.pop())
        if output.socket.is_output and output not in seen:
            seen.add(output)
            yield output
            waiting += [output.beside(socket) for socket in output.node.inputs if socket.enabled]


def are_of_view(values: NodeValues, places: Sequence[Place]) -> bool:
    """Whether inputs depend on the view, as those of films and of faces without a back, and not on images or attributes."""
    seen: set[Place] = set()
    outputs = [output for place in places for output in _sources(values, place, seen)]
    kinds = {output.node.bl_idname for output in outputs}
    return bool(_OF_VIEW & (kinds | {output.socket.name for output in outputs})) and not kinds & _PLACED


@dataclass
class _Walk:
    """What the nodes read that feed some sockets.

    Attributes:
        layers: As in ExactFeed.
        normal_maps: The outputs of Normal Map nodes that take the mesh's tangents.
    """

    values: NodeValues
    layers: dict[tuple[str, str], None] = field(default_factory=dict)
    is_of_object: bool = False
    has_bumps: bool = False
    normal_maps: list[Place] = field(default_factory=list)
    _seen: set[Place] = field(default_factory=set)

    def follow(self, first: Place) -> None:
        """Add what feeds an input. Raises NotFollowedError for a node that Cycles cannot evaluate at a point."""
        for output in _sources(self.values, first, self._seen):
            self._look_at(output)

    def _look_at(self, output: Place) -> None:
        node, kind, name = output.node, output.node.bl_idname, output.socket.name
        if not _is_known(output):
            raise NotFollowedError(f"{_name_of(output)} is not known at a point of the surface")
        self.is_of_object |= _reads_object(output)
        self.has_bumps |= kind == "ShaderNodeBump"
        match kind:
            case "ShaderNodeTexImage":
                self._default(output, (UV_LAYER, ""))
            case "ShaderNodeUVMap":
                self._add(UV_LAYER, node.uv_map)
            case "ShaderNodeVertexColor":
                self._add(ATTRIBUTE, node.layer_name)
            case "ShaderNodeAttribute" if node.attribute_type == "GEOMETRY" and node.attribute_name:
                self._add(ATTRIBUTE, node.attribute_name)
            case "ShaderNodeTexCoord" if name in {"Generated", "UV"}:
                self._add(*((GENERATED, "") if name == "Generated" else (UV_LAYER, "")))
            case "ShaderNodeNormalMap" if node.space == "TANGENT":
                self.normal_maps.append(output)
                self._add(TANGENTS, node.uv_map)
        if kind in _TEXTURES:
            self._default(output, (GENERATED, ""))
        if kind in {"ShaderNodeTexImage", "ShaderNodeTexEnvironment"}:
            self._check_image(output)

    def _check_image(self, output: Place) -> None:
        """Raise NotFollowedError for an image without pixels or without some, which Cycles shows in pink, and for movies."""
        if output.node.image is None:
            raise NotFollowedError(f"the node {title(output.node)} has no image")
        try:
            texture = self.values.images.texture(output.node.image, is_premultiplied=False)
        except UnreadableError as error:
            raise NotFollowedError(str(error)) from error
        if texture.notes:
            raise NotFollowedError(texture.notes[0])

    def _default(self, output: Place, layer: tuple[str, str]) -> None:
        """Add a layer that a texture reads where nothing feeds its vector."""
        vector = next((socket for socket in output.node.inputs if socket.identifier == "Vector"), None)
        if vector is not None and not self.values.links.source(output.beside(vector)).socket.is_output:
            self._add(*layer)

    def _add(self, kind: str, name: str) -> None:
        self.layers[kind, name] = None


def _is_known(output: Place) -> bool:
    """Whether an output is known at a point, if the inputs of its node are."""
    node, kind = output.node, output.node.bl_idname
    match kind:
        case "ShaderNodeTexImage" | "ShaderNodeVertexColor":
            return True
        case "ShaderNodeUVMap":
            return not node.from_instancer
        case "ShaderNodeAttribute":
            return node.attribute_type in {"GEOMETRY", "OBJECT"}
        case "ShaderNodeTexCoord" if node.from_instancer:
            return False
        case "ShaderNodeVectorTransform":
            return "CAMERA" not in {node.convert_from, node.convert_to}
        case "ShaderNodeVectorDisplacement":
            return node.space != "TANGENT"
    return kind in _PLAIN or kind in _TEXTURES or output.socket.name in _OUTPUTS.get(kind, ())


def _reads_object(output: Place) -> bool:
    """Whether an output depends on the object that the point is on."""
    node, name = output.node, output.socket.name
    match node.bl_idname:
        case "ShaderNodeTexCoord":
            return name == "Normal" or (name == "Object" and node.object is None)
        case "ShaderNodeAttribute":
            return node.attribute_type == "OBJECT"
        case "ShaderNodeVectorTransform":
            return "OBJECT" in {node.convert_from, node.convert_to}
        case "ShaderNodeTexImage":
            return node.projection == "BOX"  # it looks at the normal in the object's space
        case "ShaderNodeNormalMap":
            return node.space in {"OBJECT", "BLENDER_OBJECT"}
        case "ShaderNodeDisplacement" | "ShaderNodeVectorDisplacement":
            return node.space == "OBJECT"
    return node.bl_idname == "ShaderNodeObjectInfo"


def _name_of(output: Place) -> str:
    is_one_of = output.node.bl_idname in {*_OUTPUTS, "ShaderNodeLayerWeight", "ShaderNodeLightPath"}
    return f"{output.socket.name} of the node {title(output.node)}" if is_one_of else f"the node {title(output.node)}"


def exact_feed(
    values: NodeValues, places: Sequence[Place], material: int, socket: str, *, has_bumps: bool = False
) -> ExactFeed:
    """The feed of a socket whose value depends on the inputs `places`. material: its key. has_bumps: besides the nodes'.

    Raises NotFollowedError if they need more than a point of the surface: the view, light, or the mesh around it; or without
    Cycles.
    """
    walk = _walked(values, places)
    if not has_cycles():
        raise NotFollowedError("Cycles is not enabled in the preferences")
    return ExactFeed(material, socket, tuple(walk.layers), walk.is_of_object, walk.has_bumps or has_bumps)


def normal_maps(values: NodeValues, places: Sequence[Place]) -> list[Place]:
    """The outputs of Normal Map nodes in tangent space on which inputs depend that `exact_feed` has taken."""
    return _walked(values, places).normal_maps


def _walked(values: NodeValues, places: Sequence[Place]) -> _Walk:
    walk = _Walk(values)
    for place in places:
        walk.follow(place)
    return walk
