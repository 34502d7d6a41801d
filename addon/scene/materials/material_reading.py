# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the materials of the high meshes into plain data, from the shader that comes closest to a Principled BSDF."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from bpy.types import Material, Node

from ... import older_blender
from ...core.material_feeds import Constant, CutOut, DetailFeed, Feed, HighMaterial
from ...mesh.triangle_mesh import UV_LAYER
from ..textures import ImageTextures
from . import arithmetic_nodes, texture_nodes
from .exact_nodes import are_of_view, exact_feed
from .node_values import NodeValues, Place, title
from .signals import NotAffineError, NotFollowedError, Signal, combine, is_image, limited, number, scaled
from .texture_nodes import read_detail

PRINCIPLED = "ShaderNodeBsdfPrincipled"
MOST_SHADERS = 30
"""The longest chain of Mix Shader and Add Shader nodes that is followed."""
MOST_PARTS = 64
"""The most shaders that are mixed, one as often as mixes lead to it: each takes nodes of its own for Cycles."""
BASE_COLOR, ROUGHNESS, METALLIC, ALPHA, EMISSION = "Base Color", "Roughness", "Metallic", "Alpha", "Emission Color"


class Share(NamedTuple):
    """A part in a mix with transparency: the factor of a Mix Shader, or what is left of it to 1."""

    factor: Place
    is_rest: bool


@dataclass(frozen=True)
class Mix:
    """The same input of two shaders, by the factor of a Mix Shader."""

    first: "Shader"
    second: "Shader"
    factor: Place

    def side(self, is_second: bool, socket: str) -> "Shader":
        """One of the shaders, with a value for a socket: without that input, what it shows then, or the other's value."""
        shader, other = (self.second, self.first) if is_second else (self.first, self.second)
        if socket in shader.values:
            return shader
        shown = 0.0 if socket == EMISSION else UNLINKED.get(socket)
        return other if shown is None else replace(shader, values={socket: shown}, strength=None)


Value: TypeAlias = Place | float | Mix
"""An input of a shader, a constant, or a mix of both shaders' values."""


@dataclass(frozen=True)
class Shader:
    """A shader of the surface.

    Attributes:
        values: By socket of the Principled BSDF.
        strength: Of the emission, by which it is multiplied.
        opacity: The shares of the shader in mixes with transparency, whose product is its alpha's factor.
        notes: Clauses of sentences, of which normal_notes are about the normals.
        normal: What moves the normals; of several that are mixed, one.
        mixed_normals: The mix, if it has several.
        parts: How many shaders are mixed, one as often as mixes lead to it.
        node: Its node.
    """

    node: Node
    values: dict[str, Value]
    strength: Place | None = None
    normal: Place | None = None
    mixed_normals: Mix | None = None
    opacity: tuple[Share, ...] = ()
    notes: tuple[str, ...] = ()
    normal_notes: tuple[str, ...] = ()
    parts: int = 1


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
        known = self._known[output]
        if isinstance(known, NotFollowedError):
            raise known
        return known

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
                inner = self.find(place)
                return replace(inner, opacity=(*inner.opacity, Share(factor, is_rest)))
        try:
            sides = self.find(first), self.find(second)
        except NotFollowedError:
            sides = ()
        # An Emission has no surface of which an input could be mixed.
        is_surface = all(ROUGHNESS in side.values for side in sides)
        if not sides or not is_surface or sum(side.parts for side in sides) > MOST_PARTS:
            return self._first([first, second], f"the node {title(node)} mixes shaders")
        return self._mix(Mix(*sides, factor), node)

    def _mix(self, mix: Mix, node: Node) -> Shader:
        """The shader whose inputs are mixes of those of two."""
        first, second = mix.first, mix.second
        if first is second:
            return first
        sockets = dict.fromkeys((*first.values, *second.values))
        normals = [side.normal for side in (first, second) if side.normal and self._source(side.normal) is not None]
        sources = [self._source(normal) for normal in normals]
        clauses = {*first.normal_notes, *second.normal_notes}
        differ = bool(normals) and (len(normals) == 1 or sources[0] != sources[1])
        if differ:
            chosen = first if normals[0] == first.normal else second
            clauses.add(f"the node {title(node)} mixes normals, of which the map has those of {named(chosen.node)}")
        return Shader(
            first.node,
            dict.fromkeys(sockets, mix),
            None,
            normals[0] if normals else None,
            mix if differ or first.mixed_normals or second.mixed_normals else None,
            notes=tuple(dict.fromkeys((*first.notes, *second.notes))),
            normal_notes=tuple(sorted(clauses)),
            parts=first.parts + second.parts,
        )

    def _source(self, place: Place) -> Place | None:
        """The output that feeds an input; None without one."""
        source = self.values.links.source(place)
        return source if source.socket.is_output else None

    def _first(self, places: Sequence[Place], what: str) -> Shader:
        """The first of several shaders that can be read, and rather a Principled BSDF than another."""
        shaders, reasons = [], []
        for place in places:
            try:
                shaders.append(self.find(place))
            except NotFollowedError as error:
                reasons.append(error)
        if not shaders:
            raise reasons[0]
        chosen = next((one for one in shaders if one.node.bl_idname == PRINCIPLED), shaders[0])
        return replace(chosen, notes=(*chosen.notes, f"{what}, of which the maps have {named(chosen.node)}"))

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


GRAY, HALF_ROUGH = 0.8, 0.5
"""What Blender shows on faces without a material: the defaults of the Principled BSDF."""
UNLINKED = {
    "Specular IOR Level": 0.5,
    "Transmission Weight": 0.0,
    "Coat Weight": 0.0,
    "Sheen Weight": 0.0,
    "Subsurface Weight": 0.0,
}
"""Other defaults of the Principled BSDF."""
READINGS = {**texture_nodes.READINGS, **arithmetic_nodes.READINGS}
"""The functions that evaluate an output, by type of node."""
NORMAL = "Normal"
"""The socket of `HighMaterial.detail`, and of notes about it."""
CUT_OUTS = "Cut-Outs"
"""That of `HighMaterial.cutout`."""
TRANSMISSION = "Transmission Weight"


def read_materials(
    materials: Sequence[Material | None],
    images: ImageTextures,
    sockets: Collection[str] | None = None,
    *,
    is_exact: bool = False,
) -> tuple[HighMaterial, ...]:
    """The feeds of each material, in the given order; None stands for faces without a material.

    sockets: those that are wanted, with NORMAL for `detail` and CUT_OUTS for `cutout`; None for all. is_exact: whether Cycles
    evaluates what other feeds do not express, as far as it can. Some images are loaded only to know their size.
    Notes name what is left out, by socket. No material and no image raises an error.
    """
    return tuple(_read(material, images, sockets, is_exact) for material in materials)


def _read(
    material: Material | None, images: ImageTextures, sockets: Collection[str] | None, is_exact: bool
) -> HighMaterial:
    if material is None:
        return HighMaterial("none", _plain((GRAY, GRAY, GRAY), HALF_ROUGH, 0.0, 1.0))
    if not older_blender.shows_nodes(material):
        color = material.diffuse_color
        feeds = _plain(color, material.roughness, material.metallic, color[3])
        return HighMaterial(material.name, feeds)
    values = NodeValues(images, READINGS)
    try:
        shader = find_shader(values, material)
    except NotFollowedError as error:
        return HighMaterial(
            material.name, notes={"": (_sentence(material, f"its shader is left out, because {error}"),)}
        )
    notes: dict[str, tuple[str, ...]] = {}
    if shader.notes:
        notes[""] = tuple(_sentence(material, note) for note in shader.notes)
    feeds: dict[str, Feed] = {}
    for socket in shader.values:
        if sockets is not None and socket not in sockets:
            continue
        feed, lacking = _feed(values, material, shader, socket, is_exact=is_exact)
        if feed is not None:
            feeds[socket] = feed
        if lacking:
            notes[socket] = tuple(_sentence(material, text) for text in lacking)
    detail = None
    if sockets is None or NORMAL in sockets:
        detail, clauses = _detail(values, material, shader, is_exact=is_exact)
        if clauses:
            notes[NORMAL] = tuple(_sentence(material, f"Normal: {clause}") for clause in clauses)
    cutout = None
    if sockets is None or CUT_OUTS in sockets:
        cutout, clauses = _cutout(values, material, shader, is_exact=is_exact)
        if clauses:
            notes[CUT_OUTS] = tuple(_sentence(material, f"Cut-outs: {clause}") for clause in clauses)
    return HighMaterial(material.name, feeds, detail, notes, cutout=cutout)


def _cutout(
    values: NodeValues, material: Material, shader: Shader, *, is_exact: bool
) -> tuple[CutOut | None, tuple[str, ...]]:
    """Where the material is clear; None if it is solid: glass, a constant alpha above 0, or one of the view alone. And what is
    left out.

    The threshold is that which nodes compare alpha with, or else a half.
    """
    try:
        if TRANSMISSION in shader.values:
            glass = _value(values, shader, TRANSMISSION).constant
            if glass is None or glass.any():
                return None, ()
        signal = _value(values, replace(shader, values={ALPHA: 1.0} | shader.values), ALPHA)
        found = CutOut(signal.feed, 0.5 if signal.step is None else signal.step)
        # What images lack is said of their colors.
        lacking = tuple(note for note in signal.notes if "two textures" in note)
    except (NotFollowedError, NotAffineError) as error:
        found, lacking = None, (f"it is solid, because {_reason(error, shader)}",)
    if lacking and ALPHA in shader.values and are_of_view(values, places_of(shader, ALPHA)):
        return None, ()
    if lacking and is_exact and ALPHA in shader.values:
        try:
            feed = exact_feed(values, places_of(shader, ALPHA), material.session_uid, ALPHA)
        except NotFollowedError as error:
            return found, _with_reason(lacking, error)
        if len(feed.layers) == 1 and feed.layers[0][0] == UV_LAYER and not feed.is_of_object:
            return CutOut(feed), ()
        lacking = tuple(f"{text}. Cycles evaluates it only where a UV map alone feeds it" for text in lacking)
    if found is not None and isinstance(found.feed, Constant):
        return None if found.feed.color[0] > 0.0 else found, lacking
    return found, lacking


def _feed(
    values: NodeValues, material: Material, shader: Shader, socket: str, *, is_exact: bool
) -> tuple[Feed | None, tuple[str, ...]]:
    """What feeds a socket, and clauses about what is left out."""
    feed = None
    try:
        signal = _value(values, shader, socket)
        feed, lacking = signal.feed, tuple(f"{socket}: {note}" for note in signal.notes)
    except (NotFollowedError, NotAffineError) as error:
        lacking = (f"{socket} is left out, because {_reason(error, shader)}",)
    if lacking and is_exact:
        try:
            return exact_feed(values, places_of(shader, socket), material.session_uid, socket), ()
        except NotFollowedError as error:
            lacking = _with_reason(lacking, error)
    if feed is None and isinstance(shader.values[socket], Mix):
        return _of_one(values, shader, socket, lacking)
    return feed, lacking


def _with_reason(lacking: tuple[str, ...], error: NotFollowedError) -> tuple[str, ...]:
    """Clauses about what is left out, with why Cycles cannot evaluate it."""
    return tuple(text if str(error) in text else f"{text}. Cycles cannot bake it either: {error}" for text in lacking)


def _of_one(values: NodeValues, shader: Shader, socket: str, lacking: tuple[str, ...]) -> tuple[Feed, tuple[str, ...]]:
    """The feed of one of the mixed shaders, where the mix cannot be followed, and why. Nothing feeds what no shader tells."""
    mix = shader.values[socket]
    for is_second in (False, True):
        side = mix.side(is_second, socket)
        while isinstance(mix_inside := side.values[socket], Mix):
            side = mix_inside.side(False, socket)
        try:
            signal = _value(values, side, socket)
        except (NotFollowedError, NotAffineError):
            continue
        return signal.feed, tuple(f"{text}; the map has that of {named(side.node)}" for text in lacking)
    return Constant((0.0, 0.0, 0.0, 1.0)), lacking


def places_of(shader: Shader, socket: str) -> list[Place]:
    """The inputs on which the value of a socket of a shader depends."""
    value = shader.values[socket]
    places = [] if isinstance(value, float | Mix) else [value]
    if isinstance(value, Mix):
        sides = (value.side(is_second, socket) for is_second in (False, True))
        places = [value.factor, *(place for side in sides for place in places_of(side, socket))]
    if socket == EMISSION and shader.strength is not None:
        places.append(shader.strength)
    return places + [share.factor for share in shader.opacity if socket == ALPHA]


def constants(material: Material) -> dict[str, np.ndarray]:
    """The values (3,) that inputs of the Principled BSDF have all over the surface, by the names of these; empty if its shader
    cannot be read. The emission counts with its strength."""
    values = NodeValues(ImageTextures(), READINGS)
    try:
        shader = find_shader(values, material)
    except NotFollowedError:
        return {}
    found = {}
    for socket in shader.values:
        try:
            value = _value(values, shader, socket).constant
        except (NotFollowedError, NotAffineError):
            continue
        if value is not None:
            found[socket] = value
    return found


def _value(values: NodeValues, shader: Shader, socket: str) -> Signal:
    value = shader.values[socket]
    if socket == EMISSION and shader.strength is not None:
        strength = values.read(shader.strength)
        # Without strength, the color has no influence, and nodes that cannot be followed may feed it.
        is_dark = strength.constant is not None and not strength.constant.any()
        return strength if is_dark else _product(values.read(value), strength)
    if isinstance(value, Mix):
        signal = _mixed(values, value, socket)
    else:
        signal = number(value) if isinstance(value, float) else values.read(value)
    for share in shader.opacity if socket == ALPHA else ():
        factor = limited(values.read(share.factor), 0.0, 1.0)
        signal = _product(scaled(factor, -np.ones(3), np.ones(3)) if share.is_rest else factor, signal)
    return signal


def _mixed(values: NodeValues, mix: Mix, socket: str) -> Signal:
    first, second = (_value(values, mix.side(is_second, socket), socket) for is_second in (False, True))
    if first.feed == second.feed:  # whatever the factor is
        return first.noted(*second.notes)
    factor = limited(values.read(mix.factor), 0.0, 1.0)
    return combine(lambda share, a, b: a + (b - a) * share, {0, 1, 2}, [factor, first, second])


def _product(first: Signal, second: Signal) -> Signal:
    """The product of two signals of which one is constant; of two textures, an image, with a note."""
    for constant, other in ((first, second), (second, first)):
        if constant.constant is not None:
            return scaled(other, constant.constant, np.zeros(3)).noted(*constant.notes)
    chosen = first if is_image(first) or not is_image(second) else second
    return chosen.noted("two textures are multiplied, of which the map has one")


def _detail(
    values: NodeValues, material: Material, shader: Shader, *, is_exact: bool
) -> tuple[DetailFeed | None, tuple[str, ...]]:
    """What moves the normals, and clauses about what is left out."""
    detail, clauses = None, ()
    if shader.normal is not None:
        try:
            detail, clauses = read_detail(values, shader.normal)
        except (NotFollowedError, NotAffineError) as error:
            clauses = (f"the detail is left out, because {_reason(error, shader)}",)
    clauses = (*shader.normal_notes, *clauses)
    moved = displacement(values, material)
    if moved is not None:
        clauses = (*clauses, "the displacement is left out")
    if not clauses or not is_exact:
        return detail, clauses
    places = [*normal_places(shader), *([moved] if moved else ())]
    try:
        exact = exact_feed(values, places, material.session_uid, NORMAL, has_bumps=moved is not None)
    except NotFollowedError as error:
        return detail, tuple(
            text if str(error) in text else f"{text}. Cycles cannot bake it: {error}" for text in clauses
        )
    is_moved = moved is not None and material.displacement_method != "BUMP"
    return exact, ("the displacement moves no points, and counts as bumps",) if is_moved else ()


def normal_places(shader: Shader) -> list[Place]:
    """The inputs on which the normal of a shader depends."""
    mix = shader.mixed_normals
    if mix is not None:
        return [mix.factor, *normal_places(mix.first), *normal_places(mix.second)]
    return [] if shader.normal is None else [shader.normal]


def displacement(values: NodeValues, material: Material) -> Place | None:
    """The input that displaces the surface; None if nothing is connected to it."""
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") or tree.get_output_node("EEVEE")
    place = Place(output.inputs["Displacement"])
    return place if values.links.source(place).socket.is_output else None


def _plain(color: Sequence[float], roughness: float, metallic: float, alpha: float) -> dict[str, Feed]:
    numbers = UNLINKED | {ROUGHNESS: roughness, METALLIC: metallic, ALPHA: alpha, EMISSION: 0.0}
    feeds: dict[str, Feed] = {name: number(value).feed for name, value in numbers.items()}
    red, green, blue = map(float, color[:3])
    feeds[BASE_COLOR] = Constant((red, green, blue, 1.0))
    return feeds


def named(node: Node) -> str:
    """The label and the name of a node: several can have the same label."""
    return f"{title(node)} ({node.name})" if node.label and node.label != node.name else title(node)


def _reason(error: NotFollowedError | NotAffineError, shader: Shader) -> str:
    return f"the shader {title(shader.node)} {error}" if isinstance(error, NotAffineError) else str(error)


def _sentence(material: Material, text: str) -> str:
    return f'Material "{material.name}": {text}.'
