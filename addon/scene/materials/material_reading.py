# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the materials of the high meshes into plain data."""

from collections.abc import Collection, Sequence

import numpy as np
from bpy.types import Material

from ... import older_blender
from ...core.material_feeds import Constant, DetailFeed, Feed, HighMaterial
from ..images.image_pages import ImagePages
from . import arithmetic_nodes, texture_nodes
from .node_values import NodeValues, Place, title
from .signals import NotAffineError, NotFollowedError, Signal, is_image, limited, number, scaled
from .surface_shaders import ALPHA, BASE_COLOR, EMISSION, METALLIC, ROUGHNESS, Shader, Value, find_shader
from .texture_nodes import read_detail

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


def read_materials(
    materials: Sequence[Material | None], images: ImagePages, sockets: Collection[str] | None = None
) -> tuple[HighMaterial, ...]:
    """The feeds of each material, in the given order; None stands for faces without a material.

    sockets: those that are wanted, with NORMAL for `detail`; None for all. Some images are loaded only to know their size.
    Notes name what is left out, by socket. No material and no image raises an error.
    """
    return tuple(_read(material, images, sockets) for material in materials)


def _read(material: Material | None, images: ImagePages, sockets: Collection[str] | None) -> HighMaterial:
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
    for socket, value in shader.values.items():
        if sockets is not None and socket not in sockets:
            continue
        try:
            signal = _value(values, shader, socket, value)
        except (NotFollowedError, NotAffineError) as error:
            notes[socket] = (_sentence(material, f"{socket} is left out, because {_reason(error, shader)}"),)
            continue
        feeds[socket] = signal.feed
        if signal.notes:
            notes[socket] = tuple(_sentence(material, f"{socket}: {note}") for note in signal.notes)
    detail = _detail(values, material, shader, notes) if sockets is None or NORMAL in sockets else None
    return HighMaterial(material.name, feeds, detail, notes)


def _value(values: NodeValues, shader: Shader, socket: str, value: Value) -> Signal:
    if socket == EMISSION and shader.strength is not None:
        strength = values.read(shader.strength)
        # Without strength, the color has no influence, and nodes that cannot be followed may feed it.
        is_dark = strength.constant is not None and not strength.constant.any()
        return strength if is_dark else _product(values.read(value), strength)
    signal = number(value) if isinstance(value, float) else values.read(value)
    for share in shader.opacity if socket == ALPHA else ():
        factor = limited(values.read(share.factor), 0.0, 1.0)
        signal = _product(scaled(factor, -np.ones(3), np.ones(3)) if share.is_rest else factor, signal)
    return signal


def _product(first: Signal, second: Signal) -> Signal:
    """The product of two signals of which one is constant; of two textures, an image, with a note."""
    for constant, other in ((first, second), (second, first)):
        if constant.constant is not None:
            return scaled(other, constant.constant, np.zeros(3)).noted(*constant.notes)
    chosen = first if is_image(first) or not is_image(second) else second
    return chosen.noted("two textures are multiplied, of which the map has one")


def _detail(
    values: NodeValues, material: Material, shader: Shader, notes: dict[str, tuple[str, ...]]
) -> DetailFeed | None:
    """What moves the normals. Adds to `notes`."""
    found, clauses = None, ()
    if shader.normal is not None:
        try:
            found, clauses = read_detail(values, shader.normal)
        except (NotFollowedError, NotAffineError) as error:
            clauses = (f"the detail is left out, because {_reason(error, shader)}",)
    if _has_displacement(values, material):
        clauses = (*clauses, "the displacement is left out")
    if clauses:
        notes[NORMAL] = tuple(_sentence(material, f"Normal: {clause}") for clause in clauses)
    return found


def _has_displacement(values: NodeValues, material: Material) -> bool:
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") or tree.get_output_node("EEVEE")
    return values.links.source(Place(output.inputs["Displacement"])).socket.is_output


def _plain(color: Sequence[float], roughness: float, metallic: float, alpha: float) -> dict[str, Feed]:
    numbers = UNLINKED | {ROUGHNESS: roughness, METALLIC: metallic, ALPHA: alpha, EMISSION: 0.0}
    feeds: dict[str, Feed] = {name: number(value).feed for name, value in numbers.items()}
    red, green, blue = map(float, color[:3])
    feeds[BASE_COLOR] = Constant((red, green, blue, 1.0))
    return feeds


def _reason(error: NotFollowedError | NotAffineError, shader: Shader) -> str:
    return f"the shader {title(shader.node)} {error}" if isinstance(error, NotAffineError) else str(error)


def _sentence(material: Material, text: str) -> str:
    return f'Material "{material.name}": {text}.'
