# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the nodes whose values vary over the surface: images and attributes."""

from ...core.material_feeds import AVERAGE, AttributeFeed, Extension, ImageFeed
from ..images.image_pages import UnreadableError
from .coordinates import coordinates
from .node_values import NodeValues, Place, title
from .signals import NotFollowedError, Signal

ALPHA = 3


def _image(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if node.image is None:
        raise NotFollowedError(f"the node {title(node)} has no image")
    if node.projection != "FLAT":
        raise NotFollowedError(f"the node {title(node)} projects its image")
    # Blender shows colors multiplied with alpha, unless the node's alpha is used.
    is_premultiplied = not values.links.has_use(node.outputs["Alpha"])
    try:
        page = values.images.page(node.image, is_premultiplied=is_premultiplied)
    except UnreadableError as error:
        raise NotFollowedError(str(error)) from error
    uv_layer, mapping = coordinates(values, output)
    feed = ImageFeed(
        page.key,
        tiles=page.tiles,
        uv_layer=uv_layer,
        mapping=mapping,
        extension=Extension(node.extension),
        channel=ALPHA if output.socket.identifier == "Alpha" else None,
        is_smooth=node.interpolation != "Closest",
    )
    notes = page.notes
    if node.interpolation in {"Cubic", "Smart"}:
        kind = node.interpolation.lower()
        notes = (*notes, f"the {kind} interpolation of the node {title(node)} is linear in the map")
    return Signal(feed, notes, values.images.range(node.image))


def _color_attribute(values: NodeValues, output: Place) -> Signal:
    return Signal(AttributeFeed(output.node.layer_name, channel=ALPHA if output.socket.identifier == "Alpha" else None))


def _attribute(values: NodeValues, output: Place) -> Signal:
    node = output.node
    if node.attribute_type != "GEOMETRY":
        raise NotFollowedError(f"the node {title(node)} reads an attribute of the object or the scene")
    if not node.attribute_name:
        raise NotFollowedError(f"the node {title(node)} names no attribute")
    channel = {"Alpha": ALPHA, "Fac": AVERAGE}.get(output.socket.identifier)
    return Signal(AttributeFeed(node.attribute_name, channel=channel))


READINGS = {
    "ShaderNodeTexImage": _image,
    "ShaderNodeVertexColor": _color_attribute,
    "ShaderNodeAttribute": _attribute,
}
"""The functions that evaluate an output, by type of node."""
